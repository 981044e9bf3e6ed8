"""``python -m trinolab``: the command, where its script is not on the path."""

import sys
from importlib import import_module

# The commands belong to the workbench, which this package does not import.
sys.exit(import_module("workbench.cli").main())
