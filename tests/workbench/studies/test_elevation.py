"""CCD3's elevation: what is counted, and that the shipped table is what the code makes."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.bench.hand import Arm, true_visibility
from trinolab.bench.motion import random_pose
from trinolab.datasets import load_handle, load_rig, load_sweep, load_table1, paper_rig
from trinolab.measurement import Measurement
from trinolab.methods import BEST
from trinolab.pose import LOST, Pose
from workbench.plotting import plot_elevation
from workbench.studies import elevation
from workbench.studies.elevation import ELEVATIONS_DEG, SETTINGS, accuracy, kept, shared_markers

PAPER = load_handle("paper")
TABLE = load_sweep("elevation")
# Tables have six digits. Between instruction sets their numbers differ by at most 1.3e-11 of
# themselves (make verify ARGS="--only spread --groups tables").
DIGITS = 1e-5


@pytest.mark.parametrize(("degrees", "name"), [(40.0, "raised_40deg"), (90.0, "paper_trinocular")])
def test_the_shipped_rigs_are_two_of_the_elevations(degrees, name):
    for ours, shipped in zip(paper_rig(degrees).cameras, load_rig(name).cameras, strict=True):
        assert ours.T_cam_world.as_matrix() == pytest.approx(
            shipped.T_cam_world.as_matrix(), abs=1e-6
        )
        assert (ours.matrix == shipped.matrix).all()


@pytest.mark.parametrize("degrees", ELEVATIONS_DEG)
def test_ccd3_is_on_its_circle_and_looks_at_the_middle(degrees):
    """The circle, written once more: radius 549 about (0, 0, 549) in the plane x = 0, CCD1 its
    lowest point.
    """
    camera = paper_rig(degrees).cameras[2]
    spoke = camera.centre - [0, 0, 549]
    assert spoke[0] == 0
    assert np.linalg.norm(spoke) == pytest.approx(549)
    assert np.rad2deg(np.arctan2(-spoke[1], -spoke[2])) == pytest.approx(degrees)
    assert camera.axis == pytest.approx(-spoke / 549)
    assert camera.T_world_cam.rotation.as_matrix()[:, 0] == pytest.approx([1, 0, 0])


def test_a_camera_in_the_place_of_another_shares_all_it_sees():
    poses = list(load_table1().set_poses)
    rig = paper_rig(0.0)  # CCD3 is where CCD1 is
    seen = np.mean([true_visibility(rig.cameras[0], PAPER, T).sum() for T in poses])
    shared = shared_markers(rig, PAPER, poses)
    assert shared["shared_13"] == pytest.approx(seen)
    assert shared["shared_12"] == pytest.approx(shared["shared_23"])
    assert shared["shared_12"] < shared["shared_13"]


def test_table_has_every_elevation_and_estimator():
    assert list(TABLE[["elevation_deg", "estimator"]].itertuples(index=False, name=None)) == [
        (e, name) for e in ELEVATIONS_DEG for name in SETTINGS
    ]
    assert TABLE.notna().all(axis=None)
    kept_of_all = elevation.HIDDEN_POSES * TABLE.filter(like="kept_")
    assert (np.abs(kept_of_all - kept_of_all.round()) < 1e-4).all(axis=None)
    assert (TABLE["n"] <= 20).all()
    assert TABLE.groupby("estimator")["shared_12"].nunique().eq(1).all()  # the pair does not move


@pytest.mark.heavy
def test_one_cell_is_made_again():
    rig, one = paper_rig(50.0), {BEST: SETTINGS[BEST]}
    row = TABLE[(TABLE["elevation_deg"] == 50.0) & (TABLE["estimator"] == BEST)].iloc[0]
    e = accuracy(rig, one)[BEST]
    assert (e.n, e.E_t_mm, e.geodesic_mean_deg) == pytest.approx(
        (row["n"], row["E_t_mm"], row["geodesic_mean_deg"]), rel=DIGITS
    )
    assert kept(rig, 0, one)[BEST] == pytest.approx(row["kept_ccd1"], abs=1e-5)
    shared = shared_markers(rig, PAPER, elevation.random_poses())
    assert [shared[name] for name in shared] == pytest.approx(
        [row[name] for name in shared], abs=1e-5
    )


def test_the_hand_hides_that_camera_only():
    """What `kept` takes away is one camera's view: the truth, asked of the visibility."""
    rig = paper_rig(90.0)
    for hidden in range(3):
        arm = Arm(hides_from=tuple(map(float, rig.cameras[hidden].centre)))
        seen = np.array(
            [
                [true_visibility(camera, PAPER, T, arm).sum() for camera in rig.cameras]
                for T in elevation.poses_of("random")
            ]
        )
        assert seen[:, hidden].max() == 0
        others = np.delete(seen, hidden, axis=1)
        assert (others.max(axis=1) >= 4).mean() > 0.5


def test_frames_are_the_same_whichever_cell_is_first():
    rig = paper_rig(30.0)
    once = elevation.frames(rig, "table1", 3, None)
    elevation.pair_frames.cache_clear()
    again = [elevation.frame(rig, c, "table1", 3, None) for c in range(3)]
    assert all(np.array_equal(a, b) for a, b in zip(once, again, strict=True))


def test_figure_shows_the_table():
    figure = plot_elevation(TABLE, BEST)
    shared, position, kept_axes, angle = figure.axes
    assert [len(ax.get_legend().get_texts()) for ax in figure.axes] == [
        3,
        len(SETTINGS),
        3,
        len(SETTINGS),
    ]
    of_best = TABLE[TABLE["estimator"] == BEST]
    assert (shared.lines[1].get_ydata() == of_best["shared_13"]).all()
    assert (kept_axes.lines[0].get_ydata() == of_best["kept_ccd1"]).all()
    assert position.get_yscale() == angle.get_yscale() == "log"
    figure.canvas.draw()
    with pytest.raises(ValueError, match="estimator: expected one of paper"):
        plot_elevation(pd.DataFrame(TABLE), "magic")


# --- a cell, without an image


def as_it_is(T):
    return Measurement(Pose("measured", T, np.eye(6), 0.1, 4, 2), (), ())


@pytest.fixture
def measured(monkeypatch):
    """Two poses; a first estimator measures all of them a millimetre high, a second one none while
    a hand is there, and the poses' look-alikes else.
    """
    poses = {
        which: list(load_table1().set_poses[:n]) for which, n in (("table1", 20), ("random", 2))
    }
    up = RigidTransform.from_translation([0.0, -0.9, 0.0])

    def of(rig, which, hidden, settings):
        alike = [as_it_is(T * PAPER.symmetries[1]) for T in poses[which]]
        lost = [Measurement(LOST, (), ())] * len(alike)
        return {
            "high": [as_it_is(up * T) for T in poses[which]],
            "shy": alike if hidden is None else lost,
        }

    monkeypatch.setattr(elevation, "measured", of)
    monkeypatch.setattr(elevation, "poses_of", poses.__getitem__)
    monkeypatch.setattr(elevation, "random_poses", lambda: poses["random"])


@pytest.mark.usefixtures("measured")
def test_a_cell_is_a_row_an_estimator():
    cell = elevation.cell(40.0)
    assert list(cell.columns) == list(TABLE.columns)
    high, shy = cell.to_dict("records")
    assert (high["estimator"], high["elevation_deg"], high["n"]) == ("high", 40.0, 20)
    assert high["E_t_mm"] == pytest.approx(0.9)
    assert (shy["n"], shy["E_t_mm"]) == (20, pytest.approx(0.0, abs=1e-9))
    assert shy["geodesic_mean_deg"] == pytest.approx(0.0, abs=1e-5)  # look-alikes count
    assert [high[f"kept_ccd{k}"] for k in (1, 2, 3)] == [1.0, 1.0, 1.0]
    assert [shy[f"kept_ccd{k}"] for k in (1, 2, 3)] == [0.0, 0.0, 0.0]
    poses = list(load_table1().set_poses[:2])
    assert high["shared_13"] == shared_markers(paper_rig(40.0), PAPER, poses)["shared_13"]


def test_the_sweep_is_the_cells_one_after_the_other(monkeypatch):
    rows = pd.DataFrame({"estimator": ["a", "b"]})
    monkeypatch.setattr(elevation, "cell", lambda degrees: rows.assign(elevation_deg=degrees))
    table = elevation.sweep_elevation((30.0, 10.0))
    assert list(table.index) == [0, 1, 2, 3]
    found = zip(table["elevation_deg"], table["estimator"], strict=True)
    assert list(found) == list(product((30.0, 10.0), ("a", "b")))


@pytest.fixture
def who_renders(monkeypatch):
    """Frames say which camera of which rig took them, and whose view was hidden."""

    def frame(rig, c, which, k, hidden):
        return rig.cameras[-1].centre[1], c, which, k, hidden

    monkeypatch.setattr(elevation, "frame", frame)
    elevation.pair_frames.cache_clear()
    yield
    elevation.pair_frames.cache_clear()


@pytest.mark.usefixtures("who_renders")
@pytest.mark.parametrize("hidden", [None, 0, 1])
def test_the_pair_s_frames_are_the_same_at_every_elevation(hidden):
    low, high = (elevation.frames(paper_rig(e), "table1", 3, hidden) for e in (10.0, 90.0))
    assert low[:2] == high[:2]
    assert low[2][1:] == high[2][1:] == (2, "table1", 3, hidden)
    assert low[2] != high[2]


@pytest.mark.usefixtures("who_renders")
def test_a_hand_that_hides_the_third_camera_is_elsewhere_at_another_elevation():
    """And the pair sees it there."""
    low, high = (elevation.frames(paper_rig(e), "table1", 3, 2) for e in (10.0, 90.0))
    assert all(a != b for a, b in zip(low, high, strict=True))
    assert elevation.pair_frames.cache_info().currsize == 0


@pytest.mark.usefixtures("who_renders")
def test_all_poses_are_measured_by_every_estimator_of_the_settings(monkeypatch):
    asked = []

    def measure_frames(frames, rig, handle, settings):
        asked.append(([images[2] for images in frames], rig, handle.name, settings))

    monkeypatch.setattr(elevation, "measure_frames", measure_frames)
    rig = paper_rig(20.0)
    elevation.measured(rig, "table1", 1, SETTINGS)
    seen = [(rig.cameras[2].centre[1], 2, "table1", k, 1) for k in range(20)]
    assert asked == [(seen, rig, elevation.HANDLE, SETTINGS)]


def test_random_poses_are_those_of_their_seed_one_after_the_other():
    found = elevation.random_poses()
    rng = np.random.default_rng(elevation.SEED)
    assert len(found) == elevation.POSES
    for T in found[:3]:
        np.testing.assert_array_equal(T.as_matrix(), random_pose(rng).as_matrix())
