"""Settings for all tests."""

import gc
import os
from pathlib import Path

from hypothesis import settings
from progress import Progress

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    # several tests run at once; more threads than cores make all of them slow
    os.environ.setdefault(_name, "1")
# as `trinolab` sets it: OpenCV, which some tests load before, asks for it when it is loaded
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
os.environ["MPLBACKEND"] = "Agg"  # no window, also not in the kernels and commands that tests start

# Real recordings made by others: where TRINOLAB_DATA says, else in a folder shared/data beside the
# checkout.
_BESIDE = Path(__file__).resolve().parent.parent / "shared" / "data"
if "TRINOLAB_DATA" not in os.environ and _BESIDE.is_dir():
    os.environ["TRINOLAB_DATA"] = str(_BESIDE)

# The same examples in each run, however slow the machine: a failure can be repeated, a pass is no
# luck.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

# What is imported while tests are collected stays to the end: the garbage collector is not to look
# through it, then or later.
gc.disable()


def pytest_collection_finish() -> None:
    """Collect garbage again, of what the tests make."""
    gc.freeze()
    gc.enable()


def pytest_configure(config) -> None:
    """Print time and progress, in the process that leads."""
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Progress(config))
