"""The budget of what is read, where the library that reads has none: bags. Other files: test_limits."""

import pytest
from healthy import make_healthy, run

from satellites.bags import reader
from trinolab.files import limits

zstd = pytest.importorskip("rosbags.rosbag2.reader", reason="extra ros is not installed").zstd
MESSAGES = 2000 * b"a message"


def test_a_bag_of_more_than_the_budget_is_refused_in_a_line(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    make_healthy(tmp_path, 3)
    assert run("bag rec --out bag") == 0
    monkeypatch.setattr(limits, "BAG_BYTES", 1000)
    capfd.readouterr()
    assert run("track bag --out poses.csv") == 2
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert "MiB of messages at one time when decompressed, expected at most" in err


@pytest.mark.parametrize(
    ("data", "stated", "said"),
    [
        (zstd.compress(MESSAGES), len(MESSAGES) - 1, "more than 17,999 bytes"),
        (zstd.compress(MESSAGES)[:-9], len(MESSAGES), "its end is missing"),
        (zstd.compress(MESSAGES) + b"more", len(MESSAGES), "or more follows"),
        (b"no frame", 9, "cannot be decompressed"),
        (b"", limits.BAG_BYTES + 1, "expected at most 64"),
    ],
)
def test_no_more_is_decompressed_than_a_chunk_states(data, stated, said):
    with pytest.raises(ValueError, match=said):
        reader._unpacked(zstd.ZstdDecompressor(), data, stated)
    assert reader._unpacked(zstd.ZstdDecompressor(), zstd.compress(MESSAGES), 18_000) == MESSAGES
