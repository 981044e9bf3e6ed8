"""CCD3's elevation: where it stands, what is counted, and what the figure shows."""

import elevation
import numpy as np
import pandas as pd
import pytest
from elevation import SETTINGS, shared_markers

from trinolab.bench.hand import Arm, true_visibility
from trinolab.datasets import load_handle, load_rig, load_sweep, load_table1, paper_rig
from trinolab.methods import BEST
from workbench.plotting.estimators import plot_elevation

PAPER = load_handle("paper")
TABLE = load_sweep("elevation")


@pytest.mark.parametrize(("degrees", "name"), [(40.0, "raised_40deg"), (90.0, "paper_trinocular")])
def test_the_shipped_rigs_are_two_of_the_elevations(degrees, name):
    for ours, shipped in zip(paper_rig(degrees).cameras, load_rig(name).cameras, strict=True):
        assert ours.T_cam_world.as_matrix() == pytest.approx(
            shipped.T_cam_world.as_matrix(), abs=1e-6
        )
        assert (ours.matrix == shipped.matrix).all()


@pytest.mark.parametrize("degrees", elevation.ELEVATIONS_DEG)
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


def test_the_hand_hides_that_camera_only():
    """What `kept` takes away is one camera's view: the truth, asked of the visibility."""
    rig = paper_rig(90.0)
    for hidden in range(3):
        arm = Arm(hides_from=tuple(map(float, rig.cameras[hidden].centre)))
        seen = np.array(
            [
                [true_visibility(camera, PAPER, T, arm).sum() for camera in rig.cameras]
                for T in elevation.hidden_poses()
            ]
        )
        assert seen[:, hidden].max() == 0
        others = np.delete(seen, hidden, axis=1)
        assert (others.max(axis=1) >= 4).mean() > 0.5


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
