"""What runs in the reader's browser beside a chapter: the session, its displays, and OpenCV's calls."""
