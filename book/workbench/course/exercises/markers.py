"""Exercises of chapter 5: the markers."""

from __future__ import annotations

import math

import cv2
import numpy as np

from ..exercise import FunctionExerciseMaker


def _discs(greys, ground, radius, bridge=None):
    """An image of discs in two rows; a bridge joins the first row's."""
    image = np.full((40, 60), ground, dtype=int)
    v, u = np.indices(image.shape)
    places = [(10 + 20 * (k % 2), 8 + 14 * (k // 2)) for k in range(len(greys))]
    if bridge is not None:
        image[9:12, 8:50] = bridge
    for grey, (row, column) in zip(greys, places, strict=True):
        image[(v - row) ** 2 + (u - column) ** 2 <= radius**2] = grey
    return image


def _corners():
    """Five pairs of squares that touch at a corner."""
    image = np.full((40, 60), 50)
    for k in range(5):
        image[6:10, 4 + 11 * k : 8 + 11 * k] = 150
        image[10:14, 8 + 11 * k : 12 + 11 * k] = 120
    return image


def _two_runs(ground, lower, upper):
    """Six discs, of which two are dark: six contours, then four, for as many thresholds."""
    return _discs([lower, lower, upper, upper, upper, upper], ground, 3)


def _nested():
    """Three discs within a frame, and two beside it: most patches lie in another one's hole."""
    image = _discs([150, 150, 150, 150, 150], 30, 2)
    image[2:38, 2:5] = image[2:38, 27:30] = image[2:5, 2:30] = image[35:38, 2:30] = 100
    return image


def _runs(counts, fewest=4):
    """First and last threshold of each run of a count that is large enough, and the count."""
    ends = [k for k in range(len(counts)) if k + 1 == len(counts) or counts[k + 1] != counts[k]]
    starts = [0, *(end + 1 for end in ends[:-1])]
    return [(a, b, counts[a]) for a, b in zip(starts, ends, strict=True) if counts[a] >= fewest]


def _counts(image, joined=8, darkest=1):
    """Counts of the contours; `darkest` = 0 lets pixels in that equal the threshold."""
    image = np.asarray(image).astype(int)
    return [
        cv2.connectedComponents(
            (image >= threshold + darkest).astype(np.uint8), connectivity=joined
        )[0]
        - 1
        for threshold in range(int(image.max()))
    ]


NO_RUN = (math.nan, math.nan, 0)


def _longest(runs):
    return max(runs, key=lambda run: (run[1] - run[0], -run[0]), default=NO_RUN)


def _middle(run):
    return (run[0] + run[1]) / 2


plateau_exercise = FunctionExerciseMaker(
    "05.3", "The longest plateau", "ex-markers-plateau", points=4
)


@plateau_exercise.solution
def plateau(image):
    """The middle of the longest run of thresholds that show one and the same number of contours.

    A contour is a patch of pixels that are brighter than the threshold; corners join pixels, too.
    The whole thresholds from 0 to the largest grey less 1 are tried.

    Parameters
    ----------
    image
        (height, width), grey levels from 0 to 255.

    Returns
    -------
    float
        The mean of the run's first and last threshold. Of runs of one length the lowest counts.
        Only counts of at least 4 count; NaN without any.
    """
    image = np.asarray(image)
    counts = []
    for threshold in range(int(image.max())):
        labels, _ = cv2.connectedComponents((image > threshold).astype(np.uint8))
        counts.append(labels - 1)  # the first label is the dark rest
    longest, middle, start = 0, math.nan, 0
    for t in range(1, len(counts) + 1):
        if t == len(counts) or counts[t] != counts[start]:
            if counts[start] >= 4 and t - start > longest:
                longest = t - start
                middle = (start + t - 1) / 2
            start = t
    return middle


@plateau_exercise.cases
def _plateau_cases(rng):
    return [
        (_discs([200, 180, 160, 140, 120], 40, 4),),
        (_discs([220] * 6, 45, 4, bridge=120),),
        (_discs([90, 110, 130, 150, 170, 190], 30, 4) + rng.integers(0, 12, (40, 60)),),
        (_discs([250, 250, 60], 20, 4),),  # three discs: no plateau
        (_corners(),),
        (np.uint8(_discs([80, 81, 82, 83, 200, 201, 202, 203], 0, 3)),),
        ([[10, 200, 10, 150, 10, 90, 10, 60, 10]],),
        (rng.integers(0, 256, (40, 60)),),
        (_two_runs(20, 60, 100),),  # runs of one length
        (_two_runs(30, 40, 50),),
        (_discs([1, 1, 1, 1], 0, 3),),  # a run of a single threshold
        (_nested(),),
        # five patches in two runs, with a longer run of four between them
        (_discs([150, 60, 150, 115, 150, 115, 150, 200], 20, 4, bridge=115),),
    ]


@plateau_exercise.mistake("5, Exercises")
def _last_run_forgotten(image):
    """The last run is forgotten: a run ends where the count changes, and also where the list of
    the counts is over.
    """
    counts = _counts(image)
    return _middle(_longest([run for run in _runs(counts) if run[1] + 1 < len(counts)]))


@plateau_exercise.mistake("5, Exercises")
def _last_of_equals(image):
    """Of runs of one length you take the last. The lowest counts: a new run has to be longer, and
    not only as long.
    """
    return _middle(max(_runs(_counts(image)), key=_length_then_place, default=NO_RUN))


def _length_then_place(run):
    return run[1] - run[0], run[0]


@plateau_exercise.mistake("5, Exercises")
def _any_count(image):
    """Runs of any count are taken. One or two contours are the rod, or the whole image: at least 4
    are asked for.
    """
    return _middle(_longest(_runs(_counts(image), 0)))


@plateau_exercise.mistake("5, Easy and hostile images")
def _largest_count(image):
    """The run with the largest count is taken. The longest one is asked for: the largest count is
    mostly noise.
    """
    runs = _runs(_counts(image))
    return _middle(max(runs, key=lambda run: run[2], default=(math.nan, math.nan, 0)))


@plateau_exercise.mistake("5, In one minute")
def _as_bright(image):
    """Pixels that equal the threshold are counted as bright. A pixel counts if it is brighter than
    the threshold.
    """
    return _middle(_longest(_runs(_counts(image, darkest=0))))


@plateau_exercise.mistake("5, Seven pixels first")
def _without_corners(image):
    """Pixels that touch at a corner are counted as two patches. Corners join, too."""
    return _middle(_longest(_runs(_counts(image, joined=4))))


@plateau_exercise.mistake("5, Seven pixels first")
def _with_the_rest(image):
    """The dark rest is counted as a contour, so that runs of 3 pass: OpenCV's first label is the
    ground.
    """
    return _middle(_longest(_runs([count + 1 for count in _counts(image)])))


@plateau_exercise.mistake("5, Exercises")
def _end_beyond(image):
    """The middle is half a threshold too high: the end of the run is the last threshold that has
    the count, and not the first one that has another.
    """
    first, last, _ = _longest(_runs(_counts(image)))
    return (first + last + 1) / 2


@plateau_exercise.mistake("5, Exercises")
def _its_count(image):
    """This is how many contours the plateau has. A threshold is asked for, the middle of the run."""
    return float(_longest(_runs(_counts(image)))[2] or math.nan)


@plateau_exercise.mistake("5, Exercises")
def _its_length(image):
    """This is how long the run is. Its middle is asked for."""
    first, last, _ = _longest(_runs(_counts(image)))
    return last - first + 1


spot_centroid_exercise = FunctionExerciseMaker(
    "05.6", "Centroids to the upper left", "ex-markers-repair", points=3
)


def _centroid(image, u, v, half, before=0, behind=1, beside=0.0, order=1, clean=True):
    """`spot_centroid` with another window, or another end."""
    window = np.asarray(image)[v - half - before : v + half + behind]
    window = window[:, u - half - before : u + half + behind].astype(float)
    weights = window - window.min() if clean else window
    rows, columns = np.indices(weights.shape)
    total = weights.sum()
    place = [
        u - half + (weights * columns).sum() / total,
        v - half + (weights * rows).sum() / total,
    ]
    return np.array(place[::order]) + beside


@spot_centroid_exercise.solution
def spot_centroid(image, u, v, half):
    """The grey centroid of a spot in a window about a pixel.

    Parameters
    ----------
    image
        (height, width), grey levels.
    u, v
        The pixel in the window's middle, whole numbers: column and row.
    half
        The window reaches from u - half to u + half and from v - half to v + half, both included; it
        lies in the image.

    Returns
    -------
    array
        (2,), column and row of the centroid, px. The window's darkest grey counts as nothing.
    """
    window = image[v - half : v + half + 1, u - half : u + half + 1].astype(float)
    weights = window - window.min()
    rows, columns = np.indices(weights.shape)
    total = weights.sum()
    u_centre = u - half + (weights * columns).sum() / total
    v_centre = v - half + (weights * rows).sum() / total
    return np.array([u_centre, v_centre])


@spot_centroid_exercise.broken
def _last_row_missing(image, u, v, half):
    """A slice ends before its second number: the last row and the last column are missing."""
    window = image[v - half : v + half, u - half : u + half].astype(float)
    weights = window - window.min()
    rows, columns = np.indices(weights.shape)
    total = weights.sum()
    u_centre = u - half + (weights * columns).sum() / total
    v_centre = v - half + (weights * rows).sum() / total
    return np.array([u_centre, v_centre])


@spot_centroid_exercise.cases
def _spot_cases(rng):
    v, u = np.indices((31, 37))

    def disc(u0, v0, radius):
        inside = np.clip(radius + 0.5 - np.hypot(u - u0, v - v0), 0, 1)
        return np.rint(45 + 175 * inside).astype(np.uint8)

    noisy = (disc(18.3, 14.6, 4.0) - rng.integers(0, 12, u.shape)).astype(np.uint8)
    return [
        (disc(18.0, 15.0, 5.0), 18, 15, 5),
        (disc(18.0, 15.0, 5.0), 18, 15, 9),
        (disc(18.4, 14.7, 4.0), 18, 15, 5),
        (noisy, 18, 15, 6),
        (rng.integers(0, 256, u.shape).astype(np.uint8), 9, 20, 7),
        (disc(10.2, 20.4, 3.0), 10, 20, 3),
        (rng.integers(0, 256, u.shape).astype(np.uint8), 30, 4, 2),
    ]


@spot_centroid_exercise.mistake("5, Exercises")
def _half_a_pixel_added(image, u, v, half):
    """Half a pixel is added at the end. That cures spots that fill their window, and spoils those
    that do not.
    """
    return _centroid(image, u, v, half, behind=0, beside=0.5)


@spot_centroid_exercise.mistake("5, Exercises")
def _one_more_before(image, u, v, half):
    """The window begins one pixel earlier as well, so that its first pixel is no longer u - half."""
    return _centroid(image, u, v, half, before=1)


@spot_centroid_exercise.mistake("5, Exercises")
def _two_more_behind(image, u, v, half):
    """The window is one pixel too long now: u + half is its last one."""
    return _centroid(image, u, v, half, behind=2)


@spot_centroid_exercise.mistake("5, Seven pixels first")
def _row_first(image, u, v, half):
    """Row and column are exchanged: a pixel is (u, v), and an image is indexed by v first."""
    return _centroid(image, u, v, half, order=-1)


@spot_centroid_exercise.mistake("5, Seven pixels first")
def _ground_counts(image, u, v, half):
    """The ground counts: its grey pulls every centroid towards the window's middle. Take the darkest
    grey off.
    """
    return _centroid(image, u, v, half, clean=False)


EXERCISES = (
    plateau_exercise.made(),
    spot_centroid_exercise.made(),
)
