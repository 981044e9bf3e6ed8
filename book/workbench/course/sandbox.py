"""A command line that runs a student's program inside bubblewrap (``bwrap``), and whether that works
here.

The program sees the system's libraries, Python and its packages, all read-only, and writes in a folder
of its own. Nothing else is there: no other files, no solutions, no other processes, no network.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from trinolab.datasets import data_path
from trinolab.files import fetch

# what Python and its libraries read of a system
SYSTEM = (
    "/usr",
    "/bin",
    "/lib",
    "/lib32",
    "/lib64",
    "/etc/alternatives",
    "/etc/fonts",
    "/etc/ld.so.cache",
    "/etc/localtime",
    "/etc/mime.types",
    "/sys/devices/system/cpu",
)
EXERCISES = Path(__file__).resolve().parent / "exercises"
ADVICE = (
    "bwrap does not work here: students' programs run with your rights and can read the solutions. "
    "Install bubblewrap, or keep them off your files by a container: podman run --rm --network none "
    "--memory 4g --pids-limit 200 --volume ./submissions:/class IMAGE trinolab check --all /class"
)


@cache
def works() -> bool:
    """Whether a program runs inside ``bwrap`` on this system."""
    with tempfile.TemporaryDirectory() as folder:
        probe = inside([sys.executable, "-c", ""], Path(folder).resolve())
        try:
            return subprocess.run(probe, capture_output=True, timeout=60.0).returncode == 0
        except (OSError, subprocess.TimeoutExpired):
            return False


def inside(command: Sequence[str], own: Path) -> list[str]:
    """Return a command line that runs another one inside ``bwrap``.

    Parameters
    ----------
    command
        The command to be run.
    own
        The folder in which it runs, and in which alone it can write.
    """
    arguments = ["bwrap", "--unshare-all", "--die-with-parent", "--new-session"]
    arguments += ["--cap-drop", "ALL", "--dev", "/dev", "--proc", "/proc"]
    places = {Path(name) for name in (*SYSTEM, *_python(), *_packages()) if Path(name).exists()}
    roots = {path.resolve() for path in places}
    for path in sorted(roots):
        if not _is_below(path, roots):
            arguments += ["--ro-bind", str(path), str(path)]
    links = {path for path in places if path != path.resolve()}
    for path in sorted(links):
        if not _is_below(path, roots | links):
            arguments += ["--symlink", str(path.resolve()), str(path)]
    for path in (EXERCISES, data_path("exercises").resolve()):
        arguments += ["--tmpfs", str(path), "--remount-ro", str(path)]
    arguments += ["--bind", str(own), str(own), "--chdir", str(own)]
    return [*arguments, "--remount-ro", "/dev", "--remount-ro", "/", "--", *command]


def _is_below(path: Path, others: set[Path]) -> bool:
    return any(other in path.parents for other in others)


def _python() -> list[str]:
    """Python and its packages."""
    packages = [name for name in sys.path if name.endswith(("-packages", ".zip"))]
    return [sys.prefix, sys.base_prefix, str(Path(os.__file__).parent), *packages]


def _packages() -> list[str]:
    """Our packages, which need not be installed, and their data."""
    ours = [EXERCISES.parents[1], Path(fetch.__file__).resolve().parents[1], data_path()]
    recordings = os.environ.get(fetch.VARIABLE)
    return [*map(str, ours), *([recordings] if recordings else [])]
