"""Parameter sweeps of notebooks and functions: `sweep` computes one, `read_sweep` reads its table
again.

`grid` says which runs there are, `engines` where they are computed, `notebook` and `warmkernel` how
a notebook is run, `folder` how finished runs are kept, `figures` how a table is drawn.
"""

import sys
from types import ModuleType
from typing import Any

from .folder import read_sweep
from .runs import sweep

__all__ = ["read_sweep", "sweep"]


class _Callable(ModuleType):
    """This folder, called as its function: ``trinolab.sweep(...)`` is ``trinolab.sweep.sweep(...)``."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return sweep(*arguments, **options)


sys.modules[__name__].__class__ = _Callable
