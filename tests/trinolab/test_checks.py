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
    as_whole,
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


REFUSED = [
    (as_array, [[1, 2]], {"shape": (None, 3)}, r"x: expected shape \(n, 3\), got \(1, 2\)"),
    (as_array, [1, 2], {"shape": (3,)}, r"x: expected shape \(3,\), got \(2,\)"),
    (as_array, [1, np.nan], {"shape": (2,)}, r"finite numbers of at most 1e\+36, got 1 that"),
    (as_array, [1e37, -1e37, 1], {"shape": (3,)}, "got 2 that"),
    (as_array, [1, np.inf], {"shape": (2,), "finite": False}, "x: .*, got 1 that"),
    (as_array, [-1e37, np.nan], {"shape": (2,), "finite": False}, "x: .*, got 1 that"),
    (as_array, [1, "2"], {"shape": (2,)}, "x: expected numbers"),
    (as_array, [True, False], {"shape": (2,)}, "x: expected numbers"),
    (as_array, [1, True, 10**400], {"shape": (3,)}, "x: expected numbers"),
    (as_array, [[1], [2, 3]], {"shape": (2, 2)}, "x: expected numbers"),
    (as_image, np.zeros((2, 3, 3)), {}, "x: expected a grey image"),
    (as_image, np.zeros((0, 3)), {}, "x: expected a grey image"),
    (as_image, [[True]], {}, "x: expected a grey image of shape"),
    (as_image, np.zeros((2, 3)), {"size": (2, 3)}, "x: expected 2 x 3 pixels, got 3 x 2"),
    (as_image, [[np.nan]], {}, "x: expected finite grey values"),
    (as_image, [[1e37, 1.0]], {}, "x: expected finite grey values of at most"),
    (as_image, [[-1e37, 1.0]], {}, "x: expected finite grey values of at most"),
    (as_image, [[256, 0]], {"highest": 255}, "levels from 0 to 255, got 0 to 256"),
    (as_image, [[-0.5, 3.0]], {"highest": 255}, "levels from 0 to 255, got -0.5 to 3"),
    (as_number, "1", {}, "x: expected a number, got '1'"),
    (as_number, True, {}, "x: expected a number"),
    (as_number, 0, {"low": 0, "open_low": True}, r"x: expected a number above 0, got 0$"),
    (as_number, -1, {"low": 0}, r"x: expected a number of 0 or more, got -1$"),
    (as_number, 3, {"low": 0, "high": 2}, r"x: expected a number in \[0, 2\], got 3$"),
    (as_number, 10**400, {}, r"x: expected a number of at most 1e\+36, got 1000"),
    (as_number, -1e37, {}, r"x: expected a number of at most 1e\+36, got -1e\+37"),
    (as_whole, 1.5, {}, "x: expected a whole number, got 1.5"),
    (as_whole, 3, {"high": 2}, "x: expected a number"),
    (as_transform, RigidTransform.from_translation([0, 1e37, 0]), {}, "x: .* finite motion"),
    (as_transform, RigidTransform.identity(2), {}, "x: expected one RigidTransform"),
    (as_unit, [0, 0, 0], {}, "x: expected a direction"),
]


@pytest.mark.parametrize(("check", "value", "options", "words"), REFUSED)
def test_mistakes_are_named(check, value, options, words):
    with pytest.raises(ValueError, match=words):
        check(value, "x", **options)


def test_borders_pass():
    assert as_number(2, "x", 0, 2) == as_number(2, "x", 2) == 2.0
    assert as_number(-1e36, "x") == -1e36
    assert as_whole(3.0, "x", 3, 3) == 3
    assert as_image([[0.0, 255.0]], "x", (2, 1), 255).shape == (1, 2)
    assert as_image(np.full((1, 1), -1e36), "x").shape == (1, 1)
    np.testing.assert_array_equal(as_array([1e36, -1e36], "x", (2,)), [1e36, -1e36])
    np.testing.assert_allclose(as_unit([0, 3e-3, 4e-3], "x"), [0, 0.6, 0.8])


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
