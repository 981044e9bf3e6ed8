"""Files that are read and written: images, rigs, handles, poses, recordings, videos, cameras, and
unfinished work.
"""
