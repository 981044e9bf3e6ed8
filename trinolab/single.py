"""One instant for whoever asks: rig and handle by name, file or value, the pose as good as it gets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .camera import Rig
from .datasets import handle_of, rig_of
from .handle import Handle
from .measurement import Measurement, measure
from .methods import DEFAULT
from .parameters import Parameters
from .window import Window


def measure_instant(
    frames: Sequence[ArrayLike],
    rig: Rig | str | Path,
    handle: Handle | str | Path,
    prior: RigidTransform | None = None,
    parameters: Parameters | None = None,
    windows: Sequence[Window | None] | None = None,
) -> Measurement:
    """Measure the handle's pose from the frames of one instant as well as it can be done.

    The chain is that of `measurement.measure` (Eq. 16-24); the estimator is ``best`` unless the
    parameters name another one, as ``Parameters(estimator="paper")``.

    Parameters
    ----------
    frames : sequence of array_like, shape (height, width)
        One grey image a camera, in the rig's order; grey levels 0 to 255 of any number type.
    rig, handle
        A `Rig` and a `Handle`, or files, or names of shipped ones, as ``raised_40deg`` and
        ``coded``.
    prior : RigidTransform, optional
        T_world_handle expected at this instant, mm; chooses among poses that look alike.
    parameters : Parameters, optional
    windows : sequence of Window or None, optional
        Where each camera is looked at, see `measurement.measure`.

    Returns
    -------
    Measurement
        With a pose ``measured``, ``ambiguous`` or ``lost``.

    Raises
    ------
    ValueError
        For a word that names no rig or no handle, a file that cannot be read, and as
        `measurement.measure`.
    """
    p = (parameters or Parameters()).with_default(DEFAULT)
    return measure(frames, rig_of(rig), handle_of(handle), prior, p, windows)
