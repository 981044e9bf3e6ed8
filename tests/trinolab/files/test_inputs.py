"""CSV files that cannot be read: why, in words that need no knowledge of the library that reads them."""

import re

import pytest

from trinolab.files.inputs import read_csv


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "it is empty"),
        ("a title\n0\n1,2\n", "line 3 has 2 fields, the lines before have 1"),
        ("frame,t_s\n0,0.1\n1,0.2,7,8\n", "line 3 has 4 fields, the lines before have 2"),
        ('frame\n"0\n1\n', "a quotation mark is not closed"),
    ],
)
def test_the_reason_is_plain(tmp_path, text, reason):
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(f"{path}: no valid CSV ({reason})")):
        read_csv(path)
