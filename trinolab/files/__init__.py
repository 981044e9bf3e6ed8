"""Files that are read and written: images, rigs, handles, poses, recordings, and unfinished work."""
