"""The input of an estimator: the images of an instant, with its markers identified."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..checks import Array


class Identified(NamedTuple):
    """An instant with its markers identified.

    Attributes
    ----------
    images : sequence of ndarray, shape (height, width)
        One per camera.
    uv : ndarray, shape (cameras, markers, 2)
        Pixels of the markers found; NaN where a camera has none.
    T_world_handle : RigidTransform
        The pose that identified them.
    near : Rig
        The rig corrected by the markers of this instant, see `identity.reconcile`, with which a fit
        begins; the given rig where that is exact.
    motion_blur : (ndarray, ndarray) or None
        The motion expected while the shutter is open, for the estimators that fit pixels, see
        `pixels.fit_patches`.
    """

    images: Sequence[np.ndarray]
    uv: Array
    T_world_handle: RigidTransform
    near: Rig
    motion_blur: tuple[Array, Array] | None = None
