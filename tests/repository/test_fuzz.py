"""A sample of what `make verify` feeds to the readers of users' files."""

import pytest
from fuzzing import READERS, SEEDS, fuzz, kinds, refusal


@pytest.mark.parametrize(
    ("name", "kind"), [(name, kind) for name in READERS for kind in kinds(name)]
)
def test_wrong_files_are_taken_or_refused(name, kind):
    assert sum(fuzz(name, kind, 60).values()) >= 60


@pytest.mark.parametrize("name", READERS)
def test_valid_files_are_taken(name):
    for seed in SEEDS[name]:
        assert refusal(name, seed) is None
