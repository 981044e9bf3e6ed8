"""A sample of what `make verify` feeds to the readers of users' files."""

import pytest
from fuzzing import READERS, SEEDS, WAYS, fuzz, refusal


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", READERS)
def test_wrong_files_are_taken_or_refused(name, way):
    assert sum(fuzz(name, way, 60).values()) >= 60


@pytest.mark.parametrize("name", READERS)
def test_valid_files_are_taken(name):
    for seed in SEEDS[name]:
        assert refusal(name, seed) is None
