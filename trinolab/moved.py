"""Import paths that have moved out of the package, for one version: the old one still works, and says
where its module is now.

The workbench was a part of `trinolab` until 0.1. `trinolab` imports nothing of it; a user's old line
does.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import CodeType, ModuleType
from typing import Any

MOVED = {
    "trinolab.accept": "workbench.accept",
    "trinolab.classkit": "workbench.classkit",
    "trinolab.cli": "workbench.cli",
    "trinolab.cli.evaluate": "trinolab.evaluation",
    "trinolab.cli.joining": "trinolab.files.joining",
    "trinolab.course": "workbench.course",
    "trinolab.files.bags": "workbench.bags",
    "trinolab.files.provenance": "workbench.provenance",
    "trinolab.intervals": "workbench.intervals",
    "trinolab.live": "workbench.live",
    "trinolab.paper": "workbench.paper",
    "trinolab.plotting": "workbench.plotting",
    "trinolab.second": "workbench.second",
    "trinolab.slave.monitor": "workbench.teleop.monitor",
    "trinolab.slave.operators": "workbench.teleop.operators",
    "trinolab.slave.pointing": "workbench.teleop.pointing",
    "trinolab.slave.task": "workbench.teleop.task",
    "trinolab.slave.teleoperate": "workbench.teleop.teleoperate",
    "trinolab.slave.view": "workbench.teleop.view",
    "trinolab.studies": "workbench.studies",
    "trinolab.sweep": "workbench.sweep",
    "trinolab.systematic": "trinolab.sensitivity",
}


def moved_to(name: str) -> str | None:
    """Where a module that had this name is now; None if it has not moved."""
    package, rest = name, ""
    while package and package not in MOVED:
        package, _, last = package.rpartition(".")
        rest = f".{last}{rest}"
    return MOVED[package] + rest if package else None


class MovedFinder(MetaPathFinder, Loader):
    """Finds a module under the name that it had."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        name = moved_to(fullname) if fullname.startswith("trinolab.") else None
        if name is None:
            return None
        try:
            spec = find_spec(name)
        except ModuleNotFoundError:
            return None
        if spec is None:
            return None
        # Above the import system's own frames, which Python leaves out, stands the user's line.
        warnings.warn(f"{fullname} is now {name}", FutureWarning, stacklevel=2)
        is_package = spec.submodule_search_locations is not None
        return ModuleSpec(fullname, self, is_package=is_package)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(moved_to(spec.name) or "")
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """The module has run under its own name; it gets back the spec that says so."""
        if module.__spec__ is not None:
            module.__spec__ = module.__spec__.loader_state

    def get_code(self, fullname: str) -> CodeType | None:
        """For ``python -m`` with an old name."""
        spec = find_spec(moved_to(fullname) or "")
        loader: Any = spec and spec.loader
        return loader.get_code(spec.name) if spec else None
