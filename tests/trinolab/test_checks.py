"""The shared checks: what passes, and what is named when it does not."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.checks import (
    as_array,
    as_image,
    as_number,
    as_points,
    as_transform,
    as_unit,
    frozen,
    whole_rows,
)
from trinolab.files.inputs import read_toml


def test_arrays_come_back_read_only_and_are_copies():
    given = np.ones((2, 3))
    array = as_points(given, "points", 3)
    given[0, 0] = 5.0
    assert array[0, 0] == 1.0
    assert not array.flags.writeable
    assert not frozen(given).flags.writeable


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: as_array([[1, 2]], "a", (None, 3)), r"a: expected shape \(n, 3\), got \(1, 2\)"),
        (
            lambda: as_array([1, np.nan], "a", (2,)),
            "a: expected finite numbers of at most 1e[+]36, got 1 that",
        ),
        (
            lambda: as_array([1, np.inf], "a", (2,), finite=False),
            "a: expected finite numbers of at most 1e[+]36, got 1",
        ),
        (lambda: as_array("text", "a", (2,)), "a: expected numbers"),
        (lambda: as_array(["1", "2"], "a", (2,)), "a: expected numbers"),
        (lambda: as_array([1, "2"], "a", (2,)), "a: expected numbers"),
        (lambda: as_array([1, True, 10**400], "a", (3,)), "a: expected numbers"),
        (lambda: as_array([[1], [2, 3]], "a", (2, 2)), "a: expected numbers"),
        (lambda: as_image(np.zeros((2, 3, 3)), "image"), "image: expected a grey image"),
        (
            lambda: as_image(np.zeros((2, 3)), "image", (2, 3)),
            "image: expected 2 x 3 pixels, got 3 x 2",
        ),
        (lambda: as_image(np.full((2, 3), np.nan), "image"), "image: expected finite"),
        (lambda: as_image([[1, 2], [3]], "image"), "image: expected a grey image of shape"),
        (
            lambda: as_image(np.full((2, 3), 256, np.uint16), "image", highest=255),
            "levels from 0 to 255, got 256 to 256",
        ),
        (
            lambda: as_image([[-0.5, 3.0]], "image", highest=255),
            "image: expected grey levels from 0 to 255, got -0.5 to 3",
        ),
        (lambda: as_number("1", "x"), "x: expected a number, got '1'"),
        (lambda: as_number(True, "x"), "x: expected a number"),
        (lambda: as_number(0, "x", low=0, open_low=True), r"x: expected a number above 0, got 0$"),
        (lambda: as_number(10**400, "x"), "x: expected a number of at most 1e[+]36, got 1000"),
        (lambda: as_number(-1e37, "x"), "x: expected a number of at most 1e[+]36, got -1e[+]37"),
        (
            lambda: as_array([1e37, -1e37, 1], "a", (3,)),
            "a: expected finite numbers of at most 1e[+]36, got 2 that are",
        ),
        (
            lambda: as_array([-1e37, np.nan], "a", (2,), finite=False),
            "a: expected finite numbers of at most 1e[+]36, got",
        ),
        (lambda: as_image([[1e37, 1.0]], "image"), "image: expected finite grey values of at most"),
        (
            lambda: as_transform(RigidTransform.from_translation([0, 1e37, 0]), "T"),
            "T: expected a finite motion",
        ),
        (lambda: as_array([10**400], "a", (1,)), "a: expected"),
        (lambda: as_unit([0, 0, 0], "axis"), "axis: expected a direction"),
    ],
)
def test_mistakes_are_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_nan_stands_for_a_missing_point():
    assert np.isnan(as_points([[np.nan, 1]], "uv", 2)).any()


def test_a_row_beyond_all_bounds_is_a_missing_one():
    rows = whole_rows(np.array([[1.0, 2.0], [1.0, np.inf], [np.nan, 1.0], [1e37, 1.0]]))
    np.testing.assert_array_equal(rows, [[1, 2], *[[np.nan] * 2] * 3])


def test_files_that_are_none(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xfa\xfb")
    for name, words in (("a.toml", "no valid TOML"), ("b.toml", "cannot be read")):
        with pytest.raises(ValueError, match=words):
            read_toml(tmp_path / name)
