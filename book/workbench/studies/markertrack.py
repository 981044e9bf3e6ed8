"""The paper's loop in one image: predict, look for markers in the window, correct by where they are
(Sect. 4.2, 5.1).

The observation is the centre of the rectangle around the markers that were found. The paper takes
the rectangle of all that moves, as `tracker.step` does; a hand and a forearm belong to that as
well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trinolab import background, kalman
from trinolab.checks import as_image, as_number
from trinolab.handle import Handle
from trinolab.image_track import search_window
from trinolab.markers import Markers
from trinolab.measurement import markers_in
from trinolab.parameters import Parameters
from trinolab.tracker import corrected
from trinolab.window import Window


class Followed(NamedTuple):
    """What is known of the markers in one image.

    Attributes
    ----------
    t_s : float
        Time of the instant, s.
    motion : kalman.State
        Of the centre of their rectangle, px.
    box : Window
        The rectangle when it was last seen, but no smaller than it may have become since it was
        larger: what is hidden, or was cut off by the window, is still looked for. May reach out of
        the image.
    seen_s : float
        When that was, s.
    """

    t_s: float
    motion: kalman.State
    box: Window
    seen_s: float


class Look(NamedTuple):
    """One instant.

    Attributes
    ----------
    window : Window or None
        What was searched; None if there was nowhere to look.
    markers : Markers
        Found there, in pixels of the whole image.
    box : Window or None
        The smallest rectangle with all of them; may reach out of the image.
    nis : float
        Of its centre; NaN if nothing was predicted or nothing found.
    used : bool
        Whether it was there and passed the gate.
    """

    window: Window | None
    markers: Markers
    box: Window | None
    nis: float
    used: bool


def step(
    state: Followed | None,
    image: ArrayLike,
    t_s: float,
    handle: Handle,
    elsewhere: Window | None,
    parameters: Parameters | None = None,
) -> tuple[Followed | None, Look]:
    """One instant: predict, search the window, ask the gate, correct (Eq. 9-15).

    What the gate refuses is there all the same: the filter starts anew at it, with an unknown
    speed.

    Parameters
    ----------
    state : Followed or None
        After the instant before; None if nothing is followed.
    image : array_like, shape (height, width)
        Grey levels 0 to 255.
    t_s : float
        s; any step after the last one.
    handle : Handle
        Says how many markers there are, and whether they are bright.
    elsewhere : Window or None
        Inside the image: where to look if nothing is followed, or it is expected outside. The
        region that moves, or the whole image.
    parameters : Parameters, optional
        `kalman`, `markers` and `memory_s`: what was not seen for longer is no longer followed.

    Raises
    ------
    ValueError
        If the image is no grey image with levels from 0 to 255, `elsewhere` is not inside it, or
        the time does not increase.
    """
    p = parameters or Parameters()
    grey = as_image(image, "image", highest=255)
    t = as_number(t_s, "t_s", -np.inf if state is None else state.t_s, open_low=True)
    if state is None:
        markers = markers_in(grey, elsewhere, handle, p)
        box = _around(markers)
        begun = (
            None if box is None else Followed(t, kalman.initial_state(box.centre, p.kalman), box, t)
        )
        return begun, Look(elsewhere, markers, box, np.nan, box is not None)
    predicted = kalman.predict_motion(state.motion, t - state.t_s, p.kalman)
    window = (
        search_window(predicted, state.box, (grey.shape[1], grey.shape[0]), p.kalman) or elsewhere
    )
    markers = markers_in(grey, window, handle, p)
    box = _around(markers)
    observed = kalman.innovation(
        predicted,
        None if box is None else box.centre,
        kalman.observation_matrix(),
        p.kalman.sigma_px**2 * np.eye(2),
    )
    look = Look(
        window, markers, box, kalman.nis(observed), kalman.gate(observed, p.kalman.gate_probability)
    )
    if box is not None:
        shrunk = _shrunk(state.box, box, np.exp(-(t - state.seen_s) / p.memory_s))
        return Followed(t, corrected(predicted, box.centre, p.kalman), shrunk, t), look
    return (
        state._replace(t_s=t, motion=predicted) if t - state.seen_s <= p.memory_s else None
    ), look


def follow(
    images: Sequence[ArrayLike],
    times_s: ArrayLike,
    handle: Handle,
    elsewhere: Sequence[Window | None],
    parameters: Parameters | None = None,
) -> list[Look]:
    """Every instant of a sequence, from nothing known; see `step`, also for errors. The lengths
    must be the same.
    """
    state, looks = None, []
    for image, t, where in zip(images, np.asarray(times_s).tolist(), elsewhere, strict=True):
        state, look = step(state, image, t, handle, where, parameters)
        looks.append(look)
    return looks


def moving_regions(images: Sequence[ArrayLike], empty: ArrayLike) -> list[Window | None]:
    """W_ROI of every instant: the rectangle around what moves, from an image of the empty scene
    (Eq. 5, 6).

    None where nothing moves. Raises ValueError as `background.step`.
    """
    regions = []
    state = np.asarray(empty)
    for image in images:
        state, detection = background.step(state, image)
        regions.append(detection.window)
    return regions


def _shrunk(last: Window, box: Window, share: float) -> Window:
    """A rectangle made as large, about its centre, as the share of the last one that is
    remembered.
    """
    wider, higher = (
        max(0.0, share * before - now)
        for before, now in ((last.width, box.width), (last.height, box.height))
    )
    du = int(np.ceil(wider / 2))
    dv = int(np.ceil(higher / 2))
    return Window(box.u - du, box.v - dv, box.width + 2 * du, box.height + 2 * dv)


def _around(found: Markers) -> Window | None:
    """The rectangle around whole markers."""
    box = Window.around(found.uv)
    return None if box is None else box.grown(found.axes_px[:, 0].max() / 2)
