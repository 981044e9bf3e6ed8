"""CSV files that cannot be read: why, in words that need no knowledge of the library that reads them."""

import codecs
import re

import pandas as pd
import pytest

from trinolab.files import limits
from trinolab.files.inputs import read_csv, read_toml
from trinolab.files.poses import read_poses
from trinolab.files.recording import read_timestamps

PLAIN = b"frame,t_s\n0,0.5\n1,1.25\n"


@pytest.mark.parametrize(
    ("text", "columns", "reason"),
    [
        ("", None, "it is empty"),
        ("a title\n0\n1,2\n", None, "line 3 has 2 fields, the lines before have 1"),
        ("frame,t_s\n0,0.1\n1,0.2,7,8\n", None, "line 3 has 4 fields, the lines before have 2"),
        ('frame\n"0\n1\n', None, "a quotation mark is not closed"),
        ("frame,gr\xf6\xdfe\n1,2\n", None, "its text is not UTF-8"),
        ("x\n1\n", ["t_s", "frame"], "column frame, t_s is missing"),
    ],
)
def test_the_reason_is_plain(tmp_path, text, columns, reason):
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(ValueError, match=re.escape(f"{path}: no valid CSV ({reason})")):
        read_csv(path, usecols=columns)


@pytest.mark.parametrize(
    "content",
    [
        PLAIN,
        codecs.BOM_UTF8 + PLAIN.replace(b"\n", b"\r\n"),
        PLAIN.decode().encode("utf-16"),
        PLAIN.replace(b",", b", "),
        PLAIN.replace(b",", b";"),
        PLAIN.replace(b",", b";").replace(b".", b","),
        PLAIN.replace(b",", b"\t").replace(b".", b","),
        b"#one\n# two, three\n" + PLAIN,
        b"# " + PLAIN,  # numpy.savetxt
        codecs.BOM_UTF8 + b"sep=;\r\n" + PLAIN.replace(b",", b";"),
    ],
)
def test_tables_of_others_are_read(tmp_path, content):
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    table = read_csv(path)
    assert table.to_dict("list") == {"frame": [0, 1], "t_s": [0.5, 1.25]}
    assert read_timestamps(path).tolist() == [0.5, 1.25]


@pytest.mark.parametrize("separator", [" ", "\t", ",", "  "])
@pytest.mark.parametrize("head", ["", "# timestamp tx ty tz qx qy qz qw\n", "#\n# of evo\n"])
def test_a_tum_file_is_named(head, separator, tmp_path):
    path = tmp_path / "p.csv"
    path.write_text(head + "0.5 0.1 0.2 0.3 0 0 0 1".replace(" ", separator) + "\n")
    with pytest.raises(ValueError, match=r"p\.csv: is a TUM file .* frame, t_s, x_mm, y_mm, z_mm"):
        read_poses(path)


def test_a_mark_before_the_text_is_no_part_of_it(tmp_path):
    """Editors of Windows put one there."""
    path = tmp_path / "a.toml"
    path.write_text("x = 1\n", encoding="utf-8-sig")
    assert read_toml(path) == {"x": 1}


def test_a_large_table_is_read_in_pieces_and_has_so_many_words(tmp_path, monkeypatch):
    """As it is read at once, but for the words; numbers may be as many as cells."""
    rows = [f"{k},{k / 8},{'' if k % 3 else 'measured'},{k % 2 == 0}" for k in range(300)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["frame,t_s,status,even", *rows]) + "\n")
    whole = read_csv(path)
    monkeypatch.setattr(limits, "WORDS", 300)
    pd.testing.assert_frame_equal(read_csv(path), whole)
    monkeypatch.setattr(limits, "WORDS", 299)
    with pytest.raises(ValueError, match=r"a\.csv: expected at most 299 words in its cells$"):
        read_csv(path)
    path.write_text("a,b,c\n" + "1,2,3\n" * 300)
    assert len(read_csv(path)) == 300


def test_yaml_is_named(tmp_path):
    path = tmp_path / "camchain.yaml"
    path.write_text("cam0:\n  camera_model: omni\n")
    with pytest.raises(ValueError, match=r"camchain\.yaml: expected TOML, got YAML by its name"):
        read_toml(path)
