"""The image of a handle that moves while the shutter is open: the image at mid-exposure, smeared.

While the shutter is open a marker's image goes straight on by a way d. A pixel then shows the mean
over that way. A mean over shifted copies is a product of spectra: the way attenuates a frequency f
by ``sinc(f . d)``, as a lens's Gaussian blur of variance s attenuates it by ``exp(-2 pi^2 s
|f|^2)``. The handle is therefore drawn once, however long the way is.
"""

from __future__ import annotations

import numpy as np
import scipy.fft

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from ..rigid import rotation_of
from .appearance import Windows, geometry_of
from .imagemodel import CLEAR_PX, MOVING, Linear, State, greys_of, room, tallied
from .patches import Patches
from .rows import CLEARANCE, EXPOSURE, LAYERS, MODEL, POSE


def linearise_moving(state: State, here: Patches, rig: Rig, handle: Handle) -> Linear:
    """The model and its derivatives at a state, of a handle that moves while the shutter is open."""
    from . import loops

    assert state.motion_blur is not None
    k, p = here.grey.shape
    cells = here.drawn.xy.shape[2]
    layers = room((k, LAYERS, cells))
    lights = room((k, 8, cells))
    geometry = geometry_of(rig, handle, state.T_world_handle, here.views, here.drawn)
    # neighbours are smeared into each other
    loops.draw_all(here.drawn.xy, *geometry, True, layers, lights)
    ways = here.ways_px(state.motion_blur.motion)
    mean, by_u, by_v = kernels_of(ways, state.blur_px2[here.views.camera], here.drawn)

    seen = smeared(lights, mean, here)
    reach = np.abs(ways).max(initial=0.0) / 2 / min(here.at.cell)
    clear = middle(layers[:, CLEARANCE].reshape(k, 1, *here.drawn.shape), here)[:, 0]
    usable = (here.valid & (clear > CLEAR_PX + reach)).astype(float)
    rows = room((k, MODEL, p))
    greys, known = greys_of(state, here)
    cell = np.array(here.at.cell, dtype=float)
    noise = np.array(state.noise)
    pixels = float(here.at.pixels)
    loops.explain_all(
        seen, here.grey, usable, greys, known, noise, pixels, here.at.shape, cell, rows
    )
    moves = room((k, 6, cells))
    grey = room((k, 1, cells))
    loops.move_all(layers, greys, moves, grey[:, 0])
    rows[:, POSE : POSE + 6] = smeared(moves, mean, here)
    spectrum = scipy.fft.rfft2(grey.reshape(k, *here.drawn.shape))
    by_ways = windows_of(np.stack([spectrum * by_u, spectrum * by_v], axis=1), here)
    by_exposure = here.by_motion.transpose(0, 2, 1) @ by_ways
    rows[:, EXPOSURE : EXPOSURE + 6] = in_handle(by_exposure, state)
    return tallied(rows, greys, MOVING)


def kernels_of(ways: Array, blur_px2: Array, at: Windows) -> tuple[Array, Array, Array]:
    """Spectra (k, rows, columns // 2 + 1) of the kernels that smear windows by ways (k, 2), px, and
    blur them by variances (k,), and their derivatives by the ways along u and v.
    """
    from . import loops

    rows, columns = at.shape
    f_u = np.fft.rfftfreq(columns, at.cell[0])
    f_v = np.fft.fftfreq(rows, at.cell[1])
    spread = -2 * np.pi**2 * blur_px2[:, None]
    kernels = room((3, len(ways), rows, len(f_u)))
    loops.smear_kernels(f_u, f_v, ways, np.exp(spread * f_u**2), np.exp(spread * f_v**2), *kernels)
    mean, by_u, by_v = kernels
    return mean, by_u, by_v


def smeared(stack: Array, kernel: Array, here: Patches) -> Array:
    """Drawn windows (k, m, cells) after a kernel with these spectra: the windows' own part (k, m, p)."""
    spectra = scipy.fft.rfft2(stack.reshape(*stack.shape[:2], *here.drawn.shape))
    spectra *= kernel[:, None]
    return windows_of(spectra, here)


def windows_of(spectra: np.ndarray, here: Patches) -> Array:
    """The windows' own part (k, m, p) of what has these spectra (k, m, rows, columns // 2 + 1).

    Light that leaves a drawn window on one side enters it on the other, but only the border, which
    is cut off.
    """
    return middle(scipy.fft.irfft2(spectra, here.drawn.shape, overwrite_x=True), here)


def middle(drawn: np.ndarray, here: Patches) -> np.ndarray:
    """The windows' own part (k, m, p) of drawn windows (k, m, rows, columns)."""
    rows, columns = here.at.shape
    top = (drawn.shape[2] - rows) // 2
    left = (drawn.shape[3] - columns) // 2
    return drawn[:, :, top : top + rows, left : left + columns].reshape(*drawn.shape[:2], -1)


def in_handle(by_motion: Array, state: State) -> Array:
    """Derivatives (k, 6, p) by a motion in the world's frame as ones by the same in the handle's."""
    R = rotation_of(state.T_world_handle)
    k, _, p = by_motion.shape
    return (R.T @ by_motion.reshape(k, 2, 3, p)).reshape(k, 6, p)
