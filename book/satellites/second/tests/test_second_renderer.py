"""The estimators on the second renderer's images: a row by hand, and the shipped table."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import second_renderer as study
from stress import as_row
from tablerows import made_and_stored

from satellites.second import recipe
from workbench.studies.replication import Deviation

DIGITS = 1e-5  # of the shipped table


def test_a_row_by_hand():
    """Errors of 1 and 3 mm with sigmas of 1 mm: the rms of error by sigma is root 5."""
    lost = Deviation(*[np.nan] * 5)
    found = [Deviation(1.0, 6.0, 1.0, 2.0, 9.0), Deviation(3.0, 2.0, 1.0, 2.0, 9.0), lost]
    rows = pd.DataFrame([as_row(one) for one in found])
    row = study.judged(rows)
    assert (row["n"], row["measured"], row["wrong"]) == (3, 2, 2)
    assert (row["mean_mm"], row["mean_deg"]) == (2.0, 4.0)
    assert row["error_by_sigma_mm"] == pytest.approx(np.sqrt(5))
    assert (row["error_by_sigma_low_mm"], row["error_by_sigma_high_mm"]) == (1.0, 3.0)
    assert np.isnan(study.judged(rows[2:])["mean_mm"])


@pytest.mark.heavy
def test_rows_of_our_bench_are_made_again():
    made, stored = made_and_stored("second_renderer", study.table(Path()))
    pd.testing.assert_frame_equal(made, stored, rtol=DIGITS, check_dtype=False)


# --- how the table is made, without Mitsuba


def test_a_recording_is_rendered_once_for_each_recipe(tmp_path, monkeypatch):
    """And the one that there is stays."""
    shooting, rendered = recipe.recordings()["film"], []
    brighter = shooting._replace(gains=[1.1, *shooting.gains[1:]])

    def write(shooting, folder):
        rendered.append(shooting)
        folder.mkdir()

    monkeypatch.setattr(recipe, "write_recording", write)
    folders = []
    for film in (shooting, shooting, brighter):
        monkeypatch.setattr(recipe, "recordings", lambda film=film: {"film": film})
        folders.append(study.recorded("film", tmp_path / "new" / "kept"))
    assert rendered == [shooting, brighter]
    assert folders[0] == folders[1] != folders[2]
    assert set((tmp_path / "new" / "kept").iterdir()) == set(folders)
