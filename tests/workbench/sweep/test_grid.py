"""`grids`: what was typed, and what runs it gives."""

import re

import numpy as np
import pytest

from workbench.sweep.grid import MANY, Axis, Between, Interval, axes_of, parse, runs


def values(text):
    """The values of the only parameter in a text."""
    (axis,) = parse([text])
    return [setting[0] for setting in axis.settings]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a=0.5:0.95:10", [0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95]),
        ("a=0:1:3", [0.0, 0.5, 1.0]),
        ("a=8:24:3", [8, 16, 24]),
        ("a=3:1:3", [3, 2, 1]),
        ("a=log:0.01:100:5", [0.01, 0.1, 1.0, 10.0, 100.0]),
        ("a=0,1,2", [0, 1, 2]),
        ("a = 1.5, 2 ", [1.5, 2]),
        ("a=-1e-3", [-0.001]),
        ("a=true,false", [True, False]),
        ("a=paper,raised_40deg", ["paper", "raised_40deg"]),
        ("a='x, y',\"0:1:2\"", ["x, y", "0:1:2"]),
        ("a=[1, 2.5],[3]", [[1, 2.5], [3]]),
        ("a=0x10,1_000", [16, 1000]),
    ],
)
def test_what_can_be_typed(text, expected):
    found = values(text)
    assert found == expected
    assert list(map(type, found)) == list(map(type, expected))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a", "-p a: expected NAME=VALUES or @file.csv"),
        ("2a=1", "expected NAME=VALUES"),
        ("@none.csv", "none.csv: cannot be read"),
        ("a=", "-p a=: expected a:b:n, log:a:b:n, a list like 0,1,2, or @file.csv"),
        ("a=1;2", "'1;2' is no value"),
        ("a=1,,2", "'' is no value"),
        ("a=__import__('os')", "is no value"),
        ("a=1 # 2", "is no value"),
        ("a={b=1}", "expected a:b:n"),
        ("a=nan", "expected a:b:n"),
        ("a=1e999", "expected a:b:n"),
        ("a=0:1:x", "'x' is no number"),
        ("a=0:1:2:3", "is no value"),
        ("a=0:true:3", "'true' is no number"),
        ("a=0:1:1", "points, got 1"),
        ("a=0:1:2.5", "points, got 2.5"),
        ("a=0:1:1000000000", "expected 2 to"),
        ("a=log:0:1:3", "log needs"),
        ("a=1:0", "expected an interval that goes up"),
        ("a=0:inf:3", "no number, text, true, false"),
    ],
)
def test_what_is_refused(text, said):
    with pytest.raises(ValueError, match=re.escape(said)) as caught:
        parse([text])
    assert str(caught.value).startswith("none.csv" if text[0] == "@" else f"-p {text}: ")


def test_a_parameter_comes_once(tmp_path):
    (tmp_path / "runs.csv").write_text("b,a\n1,2\n")
    for texts in (["a=1", "a=2"], ["a=1", f"@{tmp_path / 'runs.csv'}"]):
        with pytest.raises(ValueError, match="a: given more than once"):
            parse(texts)


def test_a_file_has_a_row_a_setting(tmp_path):
    (tmp_path / "runs.csv").write_text(
        "name, threshold, wide\npaper, 0.5, true\n\"'a, b'\", 1, false\n"
    )
    assert runs([]) == [{}]
    assert runs([], sample=2) == [{}, {}]
    axes = parse([f"@{tmp_path / 'runs.csv'}", "seed=0,1"])
    assert runs(axes) == [
        {"name": "paper", "threshold": 0.5, "wide": True, "seed": 0},
        {"name": "paper", "threshold": 0.5, "wide": True, "seed": 1},
        {"name": "a, b", "threshold": 1, "wide": False, "seed": 0},
        {"name": "a, b", "threshold": 1, "wide": False, "seed": 1},
    ]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "no valid CSV"),
        ("a\n", "got none"),
        ("a b\n1\n", "got 'a b'"),
        ("a,a\n1,2\n", "got 'a.1'"),
        ("a,b\n1,\n", "row 1, b: '' is no value"),
        ("a\n1\nx y\n", "row 2, a: 'x y' is no value"),
        ("a\n1,2\n", "no valid CSV"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path, content, said):
    path = tmp_path / "runs.csv"
    path.write_text(content)
    with pytest.raises(ValueError, match=rf"runs\.csv: .*{re.escape(said)}"):
        parse([f"@{path}"])


def test_values_from_python():
    found = axes_of(
        {
            "a": np.linspace(0, 1, 3),
            "b": range(2),
            "c": "text",
            "e": [[1, 2], [3]],
            "f": None,
            "g": Interval(0, 1),
            "h": np.float32(0.5),
            "j": (x for x in "ab"),
        }
    )
    assert found == [
        Axis(("a",), [(0.0,), (0.5,), (1.0,)]),
        Axis(("b",), [(0,), (1,)]),
        Axis(("c",), [("text",)]),
        Axis(("e",), [([1, 2],), ([3],)]),
        Axis(("f",), [(None,)]),
        Between(("g",), Interval(0, 1)),
        Axis(("h",), [(0.5,)]),
        Axis(("j",), [("a",), ("b",)]),
    ]
    with pytest.raises(ValueError, match="b: expected at least one value, got none"):
        axes_of({"a": 1, "b": []})
    assert type(found[0].settings[0][0]) is type(found[6].settings[0][0]) is float


def test_a_sample_is_a_latin_hypercube():
    axes = parse(["a=0:1", "b=log:1:10000", "c=x,y", "n=1:10"])
    drawn = runs(axes, sample=100, whole=["n"])
    assert len(drawn) == 100
    # by definition one run in each hundredth of each axis
    assert sorted(int(100 * run["a"]) for run in drawn) == list(range(100))
    assert sorted(int(100 * np.log10(run["b"]) / 4) for run in drawn) == list(range(100))
    assert [run["c"] for run in drawn].count("x") == 50
    assert sorted(run["n"] for run in drawn) == sorted(10 * list(range(1, 11)))
    assert abs(np.corrcoef([run["a"] for run in drawn], [run["n"] for run in drawn])[0, 1]) < 0.3
    assert drawn == runs(axes, sample=100, whole=["n"])
    assert drawn != runs(axes, sample=100, sample_seed=1, whole=["n"])


def test_an_interval_needs_a_sample():
    with pytest.raises(ValueError, match="a: an interval"):
        runs(parse(["a=0:1"]))
    with pytest.raises(ValueError, match="sample: expected"):
        runs(parse(["a=0:1"]), sample=0)


def test_many_runs_must_be_meant():
    axes = parse(["a=0:1:1000", "b=0:1:1000"])
    with pytest.raises(ValueError, match="1,000,000 runs"):
        runs(axes)
    with pytest.raises(ValueError, match="must be confirmed"):
        runs(axes, sample=MANY + 1)
    assert len(runs(parse(["a=0:1:1000", "b=0:1:101"]), yes=True)) == 101_000
    assert len(runs(parse(["a=0:1:1000", "b=0:1:100"]))) == MANY  # so many are not more
    assert len(runs(axes, sample=5)) == 5
