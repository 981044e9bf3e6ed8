"""Modules that a chapter imports and the browser has not: OpenCV's calls go to OpenCV.js, what
shows and glues goes to the page, and what cannot run there says so where it is used.
"""

from __future__ import annotations

import os
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import opencv

MISSING = {
    "mujoco": "MuJoCo simulates the arm in compiled code that no browser has",
    "pyvista": "PyVista draws its scenes with VTK, which no browser has",
    "mink": "the arm's inverse kinematics need MuJoCo",
    "numba": "tracking and the fit by pixels are compiled by Numba, which no browser has",
    "mitsuba": "Mitsuba renders in compiled code that no browser has",
}


class HTML:
    """A piece of HTML that a notebook shows."""

    def __init__(self, data: str = "") -> None:
        self.data = data

    def _repr_html_(self) -> str:
        return self.data


def install(show: Callable[..., None], glue: Callable[..., None]) -> None:
    """Put the substitutes where ``import`` finds them."""
    _copy_no_descriptor()
    sys.modules["cv2"] = opencv
    sys.modules["cv2.aruco"] = opencv.aruco
    _module("myst_nb", glue=glue)
    _module("grimp", __getattr__=_absent)
    _module("pooch", os_cache=lambda name: Path("/user/cache") / name)
    display = _module("IPython.display", HTML=HTML, display=show)
    _module("IPython", display=display, version_info=(9, 0), get_ipython=lambda: None)


def _absent(name: str) -> Any:
    """A member of a module that others import and that nothing in a chapter's cells uses."""
    if name.startswith("__"):
        raise AttributeError(name)
    raise NotImplementedError(f"the package's imports are not looked into here ({name})")


def _copy_no_descriptor() -> None:
    """WASI cannot copy a descriptor, which is how the package keeps a decoder's words from standard
    error: what decodes here writes none there.
    """

    def dup(fd: int, /) -> int:
        return os.open("/tmp/no_descriptor", os.O_RDWR | os.O_CREAT)

    def dup2(fd: int, fd2: int, inheritable: bool = True) -> int:
        return fd2

    os.dup, os.dup2 = dup, dup2


def _module(name: str, **members: Any) -> types.ModuleType:
    module = types.ModuleType(name)
    module.__dict__.update(members)
    sys.modules[name] = module
    return module
