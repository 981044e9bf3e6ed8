"""The rules that pair spots, by brute force, and what their table counts."""

from itertools import permutations

import match_rivals as script
import numpy as np
import pandas as pd
import pytest

from workbench.studies import match_rivals
from workbench.studies.match_rivals import Spots


@pytest.fixture
def spots():
    """Pairs of few spots, more on one side than on the other."""
    rng = np.random.default_rng(4)
    return [
        Spots(rng.uniform(0, 4, (n, m)), rng.uniform(-1, 1, (n, m)))
        for n, m in ((3, 3), (4, 2), (2, 5), (5, 5), (1, 1))
        for _ in range(20)
    ]


def as_set(pairs):
    return {tuple(pair) for pair in pairs.tolist()}


def best_by_trial(score, allowed):
    """The pairs of which neither spot has a better partner, by looking at each."""
    found = set()
    for i, j in np.argwhere(allowed).tolist():
        rivals = [score[i, b] for b in range(score.shape[1]) if allowed[i, b]]
        rivals += [score[a, j] for a in range(score.shape[0]) if allowed[a, j]]
        if score[i, j] >= max(rivals):
            found.add((i, j))
    return found


def test_a_pair_of_both_directions_has_no_better_partner(spots):
    scores = {
        match_rivals.by_line: lambda D, S: -D,
        match_rivals.by_looks: lambda D, S: S,
    }
    for rule, score in scores.items():
        pairs = [len(rule(one, 2.0)) for one in spots]
        assert sum(pairs) > 100
        for D, S in spots:
            assert as_set(rule(Spots(D, S), 2.0)) == best_by_trial(score(D, S), D < 2.0)


def test_the_best_set_is_the_best_of_all_sets(spots):
    for D, S in spots:
        value = np.where(D < 2.0, np.maximum(S - D / 2, 0), 0)
        n, m = value.shape
        if n > m:
            value = value.T
        best = max(
            sum(value[i, j] for i, j in enumerate(chosen))
            for chosen in permutations(range(max(n, m)), min(n, m))
        )
        pairs = match_rivals.best_set(Spots(D, S), 2.0)
        scores = S[tuple(pairs.T)] - D[tuple(pairs.T)] / 2
        assert (scores > 0).all()
        assert (D[tuple(pairs.T)] < 2.0).all()
        assert abs(scores.sum() - best) < 1e-12
        for column in pairs.T:
            assert len(set(column.tolist())) == len(column)


def test_counts_by_hand():
    """Left spots are the markers 3, none, 5 and 7; right ones 7, 5, none. Marker 7 is turned away."""
    shot = match_rivals.Shot(
        None, (), (np.array([3, -1, 5, 7]), np.array([7, 5, -1])), ({3, 5}, {5, 7}), None
    )
    pairs = np.array([[3, 0], [1, 2], [0, 1]])  # right, two that are none, wrong
    assert match_rivals.counts(shot, 0, 1, pairs) == {
        "given": 3,
        "wrong": 2,
        "due": 1,
        "missing": 1,
    }
    assert as_set(match_rivals.by_layout(*shot.labels)) == {(2, 1), (3, 0)}


def test_shares_of_draws_have_intervals():
    """Of 300 pairs without a wrong one 1.3 % may be wrong (Wilson); the two draws miss 5 and 10 of 50."""
    of_each = {
        "given": [100, 200],
        "missing": [5, 10],
        "sum_mm": [1.0, 1.2],
        "sum_deg": [20.0, 2.0],
    }
    counted = {"instants": 12, "wrong": 0, "due": 50, "posed": 12, "compared": [10, 12]}
    row = script.shares(pd.DataFrame({**counted, **of_each}))
    assert row["wrong_percent_high"] == pytest.approx(100 * 1.96**2 / (300 + 1.96**2), abs=0.01)
    assert [row[f"missing_percent{end}"] for end in ("", "_low", "_high")] == [15, 10, 20]
    assert (row["E_t_mm"], row["angle_deg"]) == pytest.approx((0.1, 1.0))
