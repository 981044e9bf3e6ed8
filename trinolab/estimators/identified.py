"""What an estimator is given: the images of an instant, with its markers identified."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..checks import Array


class Identified(NamedTuple):
    """An instant with its markers identified.

    Attributes
    ----------
    images : sequence of ndarray, shape (height, width)
        One a camera.
    pixels : tuple of ndarray, one a camera, shape (n_c, 2)
        Of the markers found.
    labels : tuple of ndarray of int, one a camera, shape (n_c,)
        For each found marker its index on the handle, or -1.
    T_world_handle : RigidTransform
        The pose that identified them.
    smear : (ndarray, ndarray) or None
        The motion expected while the shutter is open, for the estimators that fit pixels, see `pixels.fit_patches`.
    """

    images: Sequence[np.ndarray]
    pixels: tuple[Array, ...]
    labels: tuple[np.ndarray, ...]
    T_world_handle: RigidTransform
    smear: tuple[Array, Array] | None = None
