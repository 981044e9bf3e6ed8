"""Likely causes why the handle is not measured in most instants, as a few of them show, for a
person to read.

A tracker cannot detect a wrong file: it finds nothing of the given handle, as if there were none.
The causes reported here are computed from the images, and are likely, not certain.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pandas as pd

from ..camera import Rig
from ..datasets import load_handle, shipped_handles
from ..handle import Handle
from ..measurement import Measurement, measure
from ..parameters import Parameters

log = logging.getLogger("trinolab")

Images = Sequence[np.ndarray]

OFTEN = 0.5  # the share of instants without a measured pose, beyond which a cause is looked for
LOOKED_AT = 9  # of those instants, evenly among all of them
FEWEST_MARKERS = 3  # of an instant, in one camera: with fewer there is nothing to explain
# The share of those looked at that have markers, from which on these count alone; and of these that a
# rig explains of which less is believed.
SHOWING = 0.25
DARK = 60.0  # the grey of the brightest thousandth of a picture, below which no marker is bright
# a pose that the pixels contradict explains nothing
CHECKED = Parameters(estimator="paper", check=True)


def lost_lines(
    table: pd.DataFrame,
    rig: Rig,
    handle: Handle,
    images_of: Callable[[list[int]], Iterator[Images]],
) -> list[str]:
    """A line with the likely cause, if more than half of the instants have no measured pose.

    Parameters
    ----------
    table : pandas.DataFrame
        Of `files.poses.pose_table`.
    rig : Rig
    handle : Handle
    images_of : callable
        Takes numbers of rows, which increase, and gives the images of each.
    """
    without = np.flatnonzero(~table["status"].isin(["measured", "ambiguous"]))
    if len(without) <= OFTEN * len(table):
        return []
    evenly = np.unique(np.linspace(0, len(without) - 1, LOOKED_AT).round().astype(int))
    with _unheard():
        instants = list(images_of(without[evenly].tolist()))
    cause = likely_cause(instants, rig, handle)
    return [f"{len(without)} of {len(table)} instants have no measured pose; {cause}"]


@contextmanager
def _unheard() -> Iterator[None]:
    """The images were read before, and what there is to say of them was said."""
    before = log.disabled
    log.disabled = True
    try:
        yield
    finally:
        log.disabled = before


def likely_cause(instants: Sequence[Images], rig: Rig, handle: Handle) -> str:
    """The likely cause why a few instants have no pose, and what they show.

    Parameters
    ----------
    instants : sequence of sequence of ndarray, shape (height, width)
        The images of the cameras at each instant.
    rig : Rig
    handle : Handle
    """
    all_own = _measured(instants, rig, handle)
    counts = [max(len(markers.uv) for markers in one.markers) for one in all_own]
    showing = [k for k, count in enumerate(counts) if count >= FEWEST_MARKERS]
    if len(showing) < SHOWING * len(instants):
        return _nothing(instants, rig, handle)
    looked = f"of {len(instants)} looked at {len(showing)} show markers"
    instants = [instants[k] for k in showing]
    if _mostly([all_own[k] for k in showing]):
        return f"{looked}, and by itself each gives a pose: likely the handle moves too fast, or is seldom seen"
    for name in shipped_handles():
        other = load_handle(name)
        if not _alike(other, handle) and _mostly(_measured(instants, rig, other)):
            return f"{looked}, those of the shipped handle {name}: likely --handle {name} is meant"
    if exchanged := _exchanged(instants, rig, handle):
        return f"{looked}, which fit if {exchanged} are exchanged: likely the cameras are"
    if rig.covariance is not None:
        by_usual_rig = _measured(instants, replace(rig, covariance=None), handle)
        if sum(one.pose.status != "lost" for one in by_usual_rig) > SHOWING * len(by_usual_rig):
            return (
                f"{looked}, which fit a rig that is less well known than its file says: likely a camera "
                "was moved, or the handle moves and the cameras are not synchronised"
            )
    return (
        f"{looked}, but no pose of {handle.name} explains them: likely the file of the handle, or that "
        "of the rig, is not of these images"
    )


def _nothing(instants: Sequence[Images], rig: Rig, handle: Handle) -> str:
    """The likely cause why there are no markers."""
    other = "dark" if handle.markers == "bright" else "bright"
    if _mostly(_measured(instants, rig, replace(handle, markers=other))):
        return f"the markers are {other}, the handle's file says {handle.markers}"
    brightest = [np.percentile(image, 99.9) for images in instants for image in images]
    if np.median(brightest) < DARK:
        return (
            f"the images are dark (99.9 % of the pixels are at most {np.median(brightest):.0f} of 255): "
            "likely too little light, or too short an exposure"
        )
    return "no camera shows markers: likely the handle is out of the picture, or hidden"


def _measured(instants: Sequence[Images], rig: Rig, handle: Handle) -> list[Measurement]:
    return [measure(images, rig, handle, parameters=CHECKED) for images in instants]


def _mostly(measurements: Sequence[Measurement]) -> bool:
    """Whether most instants have a pose."""
    return 2 * sum(one.pose.status != "lost" for one in measurements) > len(measurements)


def _alike(first: Handle, second: Handle) -> bool:
    """Whether two handles have their markers in the same places."""
    a, b = first.stated_centres, second.stated_centres
    return a.shape == b.shape and bool(np.allclose(a, b))


def _exchanged(instants: Sequence[Images], rig: Rig, handle: Handle) -> str:
    """The names of two cameras whose images, exchanged, show the handle; empty if there are none."""
    for a, b in itertools.combinations(range(len(rig.cameras)), 2):
        if rig.cameras[a].size != rig.cameras[b].size:
            continue
        order = list(range(len(rig.cameras)))
        order[a], order[b] = b, a
        if _mostly(_measured([[images[k] for k in order] for images in instants], rig, handle)):
            return f"{rig.names[a]} and {rig.names[b]}"
    return ""
