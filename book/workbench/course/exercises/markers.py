"""Exercises of chapter 5: the markers."""

from __future__ import annotations

import math

import cv2
import numpy as np

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


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
    ]


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


def _longest(runs):
    return max(runs, key=lambda run: (run[1] - run[0], -run[0]), default=(math.nan, math.nan, 0))


def _middle(run):
    return (run[0] + run[1]) / 2


def _any_count(image):
    return _middle(_longest(_runs(_counts(image), 0)))


def _largest_count(image):
    runs = _runs(_counts(image))
    return _middle(max(runs, key=lambda run: run[2], default=(math.nan, math.nan, 0)))


def _as_bright(image):
    return _middle(_longest(_runs(_counts(image, darkest=0))))


def _without_corners(image):
    return _middle(_longest(_runs(_counts(image, joined=4))))


def _with_the_rest(image):
    return _middle(_longest(_runs([count + 1 for count in _counts(image)])))


def _last_run_forgotten(image):
    counts = _counts(image)
    return _middle(_longest([run for run in _runs(counts) if run[1] + 1 < len(counts)]))


def _its_count(image):
    return float(_longest(_runs(_counts(image)))[2] or math.nan)


def _its_length(image):
    first, last, _ = _longest(_runs(_counts(image)))
    return last - first + 1


def _end_beyond(image):
    first, last, _ = _longest(_runs(_counts(image)))
    return (first + last + 1) / 2


EXERCISES = (
    ValueExercise(
        "05.1",
        "pencil",
        "Smaller markers",
        "ex-markers-smaller",
        2,
        (
            Mistake(
                "This bias is that of the old marker: 1.5 mm is the new diameter, and the formula "
                "has the radius.",
                "5, The centroid is not the centre",
                {"bias_px": 0.797},
            ),
            Mistake(
                "This bias is half of the old one. It goes with the square of the radius.",
                "5, The centroid is not the centre",
                {"bias_px": 0.399},
            ),
            Mistake(
                "The sine of the slant is missing from the bias.",
                "5, The centroid is not the centre",
                {"bias_px": 0.220},
            ),
            Mistake(
                "The bias is in mm. Pixels are asked for.",
                "5, The centroid is not the centre",
                {"bias_px": 0.0382},
            ),
            Mistake(
                "This scatter is twice the old one, as if the mask shrank with the disc. It stays "
                "2 px wider.",
                "5, The centroid is not the centre",
                {"scatter_px": 0.0223},
            ),
            Mistake(
                "This scatter is half of the old one. Smaller markers scatter more, because fewer "
                "pixels carry their light.",
                "5, The centroid is not the centre",
                {"scatter_px": 0.0058},
            ),
            Mistake(
                "This scatter is that of the old marker. R halves, in both places.",
                "5, The centroid is not the centre",
                {"scatter_px": 0.01157},
            ),
            Mistake(
                "In this scatter R is the old one above the line, where the noise is added up, and "
                "the new one below. The mask shrinks with the marker.",
                "5, The centroid is not the centre",
                {"scatter_px": 0.0460},
            ),
        ),
        {
            "bias_px": Asked(0.199, "px", within=0.005),
            "scatter_px": Asked(0.01668, "px", within=0.0004),
        },
    ),
    ValueExercise(
        "05.2",
        "pencil",
        "A search that cannot end",
        "ex-markers-count",
        2,
        (
            Mistake(
                "You have gone up after a count that is too small. Too few contours mean that the "
                "upper bound comes down.",
                "5, What the paper says",
                {"last_count": 8, "last_threshold": 219.316},
            ),
            Mistake(
                "You have stopped where all eight discs show. The search does not know that they "
                "are all: it wants 18, and goes on.",
                "5, What the paper says",
                {"last_count": 8, "thresholds": 1, "last_threshold": 132.5},
            ),
            Mistake(
                "You have stopped one step early: with 46.37 as its upper bound the interval is "
                "still longer than one grey level.",
                "5, The algorithm",
                {"thresholds": 7, "last_threshold": 46.367},
            ),
            Mistake(
                "The count falls from 8 to 4 on the way. Below 120 a bridge makes one contour of "
                "two discs.",
                "5, Seven pixels first",
                {"last_count": 8},
            ),
            Mistake(
                "The first threshold lies above the bridges, so that nothing is joined there.",
                "5, Seven pixels first",
                {"first_count": 4},
            ),
        ),
        {
            "first_count": Asked(8),
            "last_count": Asked(4),
            "thresholds": Asked(8),
            "last_threshold": Asked(45.684, "grey levels", within=0.05),
        },
    ),
    FunctionExercise(
        "05.3",
        "write",
        "The longest plateau",
        "ex-markers-plateau",
        4,
        (
            Mistake(
                "The last run is forgotten: a run ends where the count changes, and also where the "
                "list of the counts is over.",
                "5, Exercises",
                _last_run_forgotten,
            ),
            Mistake(
                "Runs of any count are taken. One or two contours are the rod, or the whole image: "
                "at least 4 are asked for.",
                "5, Exercises",
                _any_count,
            ),
            Mistake(
                "The run with the largest count is taken. The longest one is asked for: the largest "
                "count is mostly noise.",
                "5, Easy and hostile images",
                _largest_count,
            ),
            Mistake(
                "Pixels that equal the threshold are counted as bright. A pixel counts if it is "
                "brighter than the threshold.",
                "5, In one minute",
                _as_bright,
            ),
            Mistake(
                "Pixels that touch at a corner are counted as two patches. Corners join, too.",
                "5, Seven pixels first",
                _without_corners,
            ),
            Mistake(
                "The dark rest is counted as a contour, so that runs of 3 pass: OpenCV's first label "
                "is the ground.",
                "5, Seven pixels first",
                _with_the_rest,
            ),
            Mistake(
                "The middle is half a threshold too high: the end of the run is the last threshold "
                "that has the count, and not the first one that has another.",
                "5, Exercises",
                _end_beyond,
            ),
            Mistake(
                "This is how many contours the plateau has. A threshold is asked for, the middle of "
                "the run.",
                "5, Exercises",
                _its_count,
            ),
            Mistake(
                "This is how long the run is. Its middle is asked for.",
                "5, Exercises",
                _its_length,
            ),
        ),
        plateau,
        _plateau_cases,
    ),
    ValueExercise(
        "05.4",
        "predict",
        "More noise",
        "ex-markers-change",
        3,
        (
            Mistake(
                "The curves of the bias are made without any noise, so that none of them moves. "
                "Noise makes scatter, and no bias.",
                "5, The centroid is not the centre",
                {"curve": "all"},
            ),
            Mistake(
                "The standard scene has noise in the recordings, but its curve of the bias is made "
                "without any.",
                "5, The centroid is not the centre",
                {"curve": "standard scene"},
            ),
            Mistake(
                "The bias decides the position error, and the bias has not changed. It is the angle "
                "that has a share of noise.",
                "5, The paper and ours, side by side",
                {"changes_more": "E_t"},
            ),
            Mistake(
                "This scatter has grown with the read noise alone. The shot noise stays, and "
                "variances add up.",
                "5, What happens if the camera is noisier?",
                {"scatter_px": 0.0464},
            ),
            Mistake(
                "This is the scatter at the old read noise, 1.5: run the chapter with the new one.",
                "5, What happens if the camera is noisier?",
                {"scatter_px": 0.01159},
            ),
        ),
        {
            "changes_more": Asked("E_alpha", choices=("E_t", "E_alpha")),
            "curve": Asked(
                "none", choices=("dark rod", "grey rod", "standard scene", "all", "none")
            ),
            "scatter_px": Asked(0.0245, "px", within=0.0005),
        },
    ),
    ValueExercise(
        "05.5",
        "project",
        "A better centre",
        "ex-markers-project",
        5,
        (
            Mistake(
                "These are rms values of single coordinates. Of each centroid the distance is asked "
                "for: sqrt 2 times as much.",
                "5, The centroid is not the centre",
                {"before_px": 0.796, "after_px": 0.484},
            ),
            Mistake(
                "The centroids have been moved inwards. They lie too far inwards already, and have "
                "to move away from the rod's axis.",
                "5, The centroid is not the centre",
                {"after_px": 1.698},
            ),
            Mistake(
                "Nothing has changed: have the centroids been moved, and are they moved in px?",
                "5, The centroid is not the centre",
                {"after_px": 1.126},
            ),
        ),
        {
            "before_px": Asked(1.126, "px", within=0.02),
            "after_px": Asked(0.684, "px", within=0.03),
        },
    ),
)
