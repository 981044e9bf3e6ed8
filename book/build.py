"""Build the book: ``python book/build.py``, see `workbench.pages.build`."""

import sys

from workbench.pages.build import command

sys.exit(command(sys.argv[1:]))
