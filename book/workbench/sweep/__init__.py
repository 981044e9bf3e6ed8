"""Parameter sweeps of notebooks and functions: `sweep` computes one, `read_sweep` reads its table
again.

`grid` says which runs there are, `engines` where they are computed, `notebook` and `warmkernel` how
a notebook is run, `folder` how finished runs are kept, `figures` how a table is drawn.
"""

from .folder import read_sweep
from .runs import sweep

__all__ = ["read_sweep", "sweep"]
