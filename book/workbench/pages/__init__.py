"""The building of the book: `build` runs what is stale and makes the pages; the other modules make parts of
them.
"""
