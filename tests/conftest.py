"""Settings for all tests."""

import os

os.environ["MPLBACKEND"] = "Agg"  # no window, also not in the kernels and commands that tests start
