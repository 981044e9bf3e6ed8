"""The files of exercises that are answered with values: what is read, and what is refused and how."""

import pytest

from workbench.course.exercise import Asked
from workbench.course.values import read_values

GOOD = """
[[exercise]]
number = "04.9"
kind = "pencil"
title = "A gain"
label = "ex-gain"
points = 2

[exercise.asked]
gain = { value = 0.4, unit = "mm", within = 0.01 }
which = { value = "first", choices = ["first", "second"] }

[[exercise.mistake]]
gives = { gain = 0.6 }
says = "This is the rest."
read = "4, Predict"
"""


def test_an_exercise_is_read_with_all_its_fields(tmp_path):
    (tmp_path / "04.toml").write_text(GOOD)
    (exercise,) = read_values(tmp_path / "04.toml")
    assert (exercise.number, exercise.kind, exercise.points) == ("04.9", "pencil", 2)
    assert exercise.asked == {
        "gain": Asked(0.4, "mm", 0.01),
        "which": Asked("first", choices=("first", "second")),
    }
    (mistake,) = exercise.mistakes
    assert (mistake.gives, mistake.says, mistake.read) == (
        {"gain": 0.6},
        "This is the rest.",
        "4, Predict",
    )


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('kind = "pencil"', ""), "04.9: 'kind' is missing"),
        (("points = 2", "points = 2\nextra = 1"), "04.9: 'extra' is none of"),
        (("value = 0.4, ", ""), "gain: 'value' is missing"),
        (("within = 0.01", "wthin = 0.01"), "gain: 'wthin' is none of"),
        (('"first", choices', '"third", choices'), "which: expected one of the choices"),
        (("{ gain = 0.6 }", "{ gian = 0.6 }"), "mistake 1: gives: 'gian' is none of"),
        (('says = "This is the rest."', ""), "mistake 1: 'says' is missing"),
    ],
)
def test_what_is_wrong_is_named_with_file_and_field(tmp_path, change, says):
    path = tmp_path / "04.toml"
    path.write_text(GOOD.replace(*change))
    with pytest.raises(ValueError, match=r"04\.toml: ") as refusal:
        read_values(path)
    assert says in str(refusal.value)
