"""Wrong answers that differ from right ones in a corner alone: none of them is taken for right."""

import cv2
import numpy as np
import pytest

from workbench.course.child import outcome
from workbench.course.exercises import exercise
from workbench.course.grading import call_of, judge_outcomes


def projected(p, T_cam_world, matrix):
    x, y, z = T_cam_world[:3, :3] @ p + T_cam_world[:3, 3]
    u, v, w = matrix @ [x, y, z]
    return z > 0, u / w, v / w


def up_to_the_width(p, T_cam_world, matrix, size):
    before, u, v = projected(p, T_cam_world, matrix)
    return before and -0.5 <= u <= size[0] and -0.5 <= v <= size[1] - 0.5


def up_to_the_height(p, T_cam_world, matrix, size):
    before, u, v = projected(p, T_cam_world, matrix)
    return before and -0.5 <= u <= size[0] - 0.5 and -0.5 <= v <= size[1]


def a_little_to_the_left(p, T_cam_world, matrix, size):
    before, u, v = projected(p, T_cam_world, matrix)
    return before and -0.7 <= u <= size[0] - 0.5 and -0.5 <= v <= size[1] - 0.5


def longest_run(counts):
    """The middle of the longest run of equal counts from 4 on."""
    best, middle, start = 0, np.nan, 0
    for t in range(1, len(counts) + 1):
        if t == len(counts) or counts[t] != counts[start]:
            if counts[start] >= 4 and t - start > best:
                best, middle = t - start, (start + t - 1) / 2
            start = t
    return middle


def outer_contours(image):
    image = np.asarray(image)
    found = [
        cv2.findContours((image > t).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        for t in range(int(image.max()))
    ]
    return longest_run(list(map(len, found)))


def commonest_count(image):
    image = np.asarray(image)
    counts = np.array(
        [
            cv2.connectedComponents((image > t).astype(np.uint8))[0] - 1
            for t in range(int(image.max()))
        ]
    )
    large = counts[counts >= 4]
    if not len(large):
        return np.nan
    where = np.flatnonzero(counts == np.bincount(large).argmax())
    return (where[0] + where[-1]) / 2


def alike_where_both_are_flat(template, image):
    S = exercise("06.4").solution(template, image)
    if np.ptp(template) == 0:
        windows = np.lib.stride_tricks.sliding_window_view(image, np.shape(template))
        S[np.ptp(windows, axis=(2, 3)) == 0] = 1
    return S


NEAR_MISSES = [
    ("02.3", up_to_the_width),
    ("02.3", up_to_the_height),
    ("02.3", a_little_to_the_left),
    ("05.3", outer_contours),
    ("05.3", commonest_count),
    ("06.4", alike_where_both_are_flat),
]


@pytest.mark.parametrize(("number", "function"), NEAR_MISSES)
def test_a_near_miss_is_refused_and_gets_no_wrong_name(number, function):
    asked = exercise(number)
    found = [outcome(function, case) for case in call_of(asked).cases]
    verdict = judge_outcomes(asked, found)
    assert not verdict.right
    assert verdict.says.startswith(f"{asked.name}(")
