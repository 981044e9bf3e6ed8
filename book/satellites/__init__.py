"""What is beyond the paper and its chapters, each by itself: the live page, the data sheet (`accept`), the
second renderer, the class kit and the bags. They import both packages; only the commands, the pages, their
own chapters and the scripts of tables import them.
"""
