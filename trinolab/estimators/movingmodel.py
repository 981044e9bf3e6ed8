"""The image of a handle that moves while the shutter is open: the image at mid-exposure, smeared.

While the shutter is open a marker's image goes straight on by a way d. What a pixel then shows is
the mean over that way. A mean over shifted copies is a product of spectra: of a frequency f is left
``sinc(f . d)``, as of a lens's Gaussian blur with the variance s is left ``exp(-2 pi^2 s |f|^2)``.
So the handle is drawn once, however long the way is.
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
from .rows import CLEARANCE, EXPOSURE, LAYERS, POSE


def linearise_moving(state: State, here: Patches, rig: Rig, handle: Handle) -> Linear:
    """The model and its derivatives at a state, of a handle that moves while the shutter is open."""
    from . import loops

    assert state.motion_blur is not None
    k, p = here.grey.shape
    cells = here.drawn.xy.shape[2]
    layers = np.empty((k, LAYERS, cells))
    lights = np.empty((k, 8, cells))
    geometry = geometry_of(rig, handle, state.T_world_handle, here.views, here.drawn)
    # neighbours are smeared into each other
    loops.draw_all(here.drawn.xy, *geometry, True, layers, lights)
    ways = here.ways_px(state.motion_blur.motion)
    f_u, f_v = frequencies(here.drawn)
    along = f_u * ways[:, :1, None] + f_v * ways[:, 1:, None]  # f . d, (k, rows, columns)
    spread = -2 * np.pi**2 * state.blur_px2[:, None, None]
    lens = (np.exp(spread * f_u**2) * np.exp(spread * f_v**2))[here.views.camera]
    smeared = smear(along)
    mean = even(lens * smeared)

    seen = windows_of(spectra_of(lights, here) * mean[:, None], here)
    reach = np.abs(ways).max(initial=0.0) / 2 / min(here.at.cell)
    clear = middle(layers[:, CLEARANCE, None], here)[:, 0] > CLEAR_PX + reach
    usable = (here.valid & clear.reshape(k, p)).astype(float)
    rows = room(k, p)
    greys, known = greys_of(state, here)
    cell = np.array(here.at.cell, dtype=float)
    loops.explain_all(
        seen, here.grey, usable, greys, known, np.array(state.noise), float(here.at.pixels),
        here.at.shape, cell, rows,
    )  # fmt: skip
    moves = np.empty((k, 6, cells))
    grey = np.empty((k, cells))
    loops.move_all(layers, greys, moves, grey)
    rows[:, POSE : POSE + 6] = windows_of(spectra_of(moves, here) * mean[:, None], here)
    # of a way along u the real part, along v the imaginary one
    by_way = even(lens * smear_by(along, smeared) * (f_u + 1j * f_v))
    spectrum = scipy.fft.fft2(grey.reshape(along.shape))
    by_ways = windows_of((spectrum * by_way)[:, None], here)
    by_exposure = here.by_motion.transpose(0, 2, 1) @ by_ways
    rows[:, EXPOSURE : EXPOSURE + 6] = in_handle(by_exposure, state)
    return tallied(rows, greys, MOVING)


def frequencies(at: Windows) -> tuple[Array, Array]:
    """The frequencies of windows along u, (columns,), and along v, (rows, 1), cycles a pixel."""
    rows, columns = at.shape
    f_u = np.fft.fftfreq(columns, at.cell[0])
    f_v = np.fft.fftfreq(rows, at.cell[1])
    return f_u.astype(float), f_v[:, None].astype(float)


def smear(along: Array) -> Array:
    """What is left of a frequency that a way turns by ``along`` cycles: the mean of
    ``exp(-2 pi i s along)`` over times s of the exposure from -1/2 to 1/2.
    """
    return np.sinc(along)


def smear_by(along: Array, smeared: Array) -> Array:
    """Derivative of `smear` by ``along``, where that is `smeared`."""
    is_small = np.abs(along) < 1e-3
    safe = np.where(is_small, 1.0, along)
    return np.where(is_small, -(np.pi**2) / 3 * along, (np.cos(np.pi * safe) - smeared) / safe)


def even(kernel: np.ndarray) -> np.ndarray:
    """The spectrum (k, rows, columns) of a kernel with the highest frequencies of even numbers of
    cells made those of a real kernel.

    Such a frequency is its own opposite, and does not show which way it goes: it gets the mean of
    both. As it is, it would carry one window of a pair over into the other, see `spectra_of`.
    """
    rows, columns = kernel.shape[-2:]
    result = kernel.copy()
    if rows % 2 == 0:
        line = kernel[..., rows // 2, :]
        result[..., rows // 2, :] = (line + np.roll(line[..., ::-1], 1, axis=-1)) / 2
    if columns % 2 == 0:
        line = result[..., columns // 2]
        result[..., columns // 2] = (line + np.roll(line[..., ::-1], 1, axis=-1)) / 2
    return result


def in_handle(by_motion: Array, state: State) -> Array:
    """Derivatives (k, 6, p) by a motion in the world's frame as ones by the same in the handle's."""
    R = rotation_of(state.T_world_handle)
    k, _, p = by_motion.shape
    return (R.T @ by_motion.reshape(k, 2, 3, p)).reshape(k, 6, p)


def spectra_of(stack: Array, here: Patches) -> np.ndarray:
    """The spectra of drawn windows (k, m, cells), m even, two at a time: as the real and the
    imaginary part of one, shape (k, m / 2, rows, columns).
    """
    pairs = np.empty((len(stack), stack.shape[1] // 2, *here.drawn.shape), complex)
    flat = pairs.reshape(*pairs.shape[:2], -1)
    flat.real = stack[:, 0::2]
    flat.imag = stack[:, 1::2]
    return np.asarray(scipy.fft.fft2(pairs, overwrite_x=True))


def windows_of(spectra: np.ndarray, here: Patches) -> Array:
    """The windows (k, m, p) whose spectra were multiplied by those of real kernels; see
    `spectra_of`.

    What leaves a drawn window on one side comes in on the other, and gets no further than the
    border that is left out.
    """
    pairs = middle(scipy.fft.ifft2(spectra, overwrite_x=True), here)
    k, m, p = pairs.shape
    return np.stack([pairs.real, pairs.imag], axis=2).reshape(k, 2 * m, p)


def middle(drawn: np.ndarray, here: Patches) -> np.ndarray:
    """The windows' own part (k, m, p) of drawn windows (k, m, cells) or (k, m, rows, columns)."""
    rows, columns = here.at.shape
    k, m = drawn.shape[:2]
    whole = drawn.reshape(k, m, *here.drawn.shape)
    top = (whole.shape[2] - rows) // 2
    left = (whole.shape[3] - columns) // 2
    return whole[:, :, top : top + rows, left : left + columns].reshape(k, m, rows * columns)
