"""A marker's own place beside that of its column and row: the handle, its file, the bench that draws
it, and every estimator.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench
from trinolab.bench.rays import cast, marker_outline
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators.centroids import centre_pixels
from trinolab.files.rigs import read_handle, write_handle
from trinolab.measurement import measure
from trinolab.methods import ESTIMATORS
from trinolab.parameters import Parameters
from trinolab.rigid import motion_between

RIG, CODED = load_rig("raised_40deg"), load_handle("coded")
POSE = RigidTransform.from_components(
    [10.0, 5.0, 560.0], Rotation.from_euler("ZYX", [170.0, 15.0, 40.0], degrees=True)
)


def moved(handle, offsets):
    return replace(handle, offsets_mm=tuple(map(tuple, offsets.tolist())))


def rng():
    return np.random.default_rng(0)


def beside(sigma_mm):
    """A handle whose markers lie beside their places, in all directions."""
    return moved(CODED, rng().normal(0.0, sigma_mm, (12, 3)))


def test_an_offset_by_hand():
    # marker 0 is at (0, 10, 5) and looks along z: 0.3 aside, 0.1 along the axis, 0.4 outwards
    offsets = np.zeros((12, 3))
    offsets[0] = [0.3, 0.1, 0.4]
    handle = moved(CODED, offsets)
    radius = np.hypot(0.3, 5.4)
    np.testing.assert_allclose(handle.marker_centres[0], [0.3, 10.1, 5.4], atol=1e-12)
    assert handle.marker_radii[0] == pytest.approx(radius)
    assert handle.marker_angles[0] == pytest.approx(np.arctan2(0.3, 5.4))
    np.testing.assert_allclose(handle.marker_normals[0], [0.3 / radius, 0, 5.4 / radius])
    # the others are where they were; their angles are computed in another way
    np.testing.assert_array_equal(handle.marker_centres[1:], CODED.marker_centres[1:])
    np.testing.assert_allclose(handle.marker_angles[1:], CODED.marker_angles[1:], atol=1e-14)
    np.testing.assert_allclose(handle.marker_radii[1:], 5.0, atol=1e-14)


def test_angles_stay_near_those_of_the_columns():
    # also where the arc tangent jumps, at 180 deg
    handle = beside(0.1)
    away = np.abs(handle.marker_angles - handle.stated_angles)
    assert 0 < away.max() < 0.1


def test_the_layout_s_symmetries_do_not_ask_for_offsets():
    paper = load_handle("paper")
    off = moved(paper, rng().normal(0.0, 0.05, (12, 3)))
    assert len(off.symmetries) == len(paper.symmetries) == 12


def test_a_handle_file_keeps_them(tmp_path):
    handle = replace(beside(0.05), placement_sigma_mm=0.002)
    write_handle(handle, tmp_path / "h.toml")
    assert read_handle(tmp_path / "h.toml") == handle
    write_handle(CODED, tmp_path / "plain.toml")
    assert "offsets_mm" not in (tmp_path / "plain.toml").read_text()
    assert read_handle(tmp_path / "plain.toml") == CODED


@pytest.mark.parametrize(
    ("offsets", "said"),
    [
        ([[0.0, 0.0, 0.0]], r"^offsets_mm: expected shape \(12, 3\), got \(1, 3\)"),
        ("no", "^offsets_mm: expected numbers"),
        ([[0.0, 0.0, np.nan]] * 12, "^offsets_mm: expected finite numbers"),
        ([[1.6, 0.0, 0.0]] * 12, r"^offsets_mm: the largest: .* in \[-inf, 1\.5\], got 1\.6"),
        ([[0.0, -0.3, 0.0], [0.0, 0.3, 0.0]] * 6, "markers 0 and 1 overlap"),
    ],
)
def test_offsets_that_cannot_be(offsets, said):
    rows = ((10.0, 6.5),) * 6  # half a millimetre between them
    with pytest.raises(ValueError, match=said):
        replace(CODED, rows_mm=rows, offsets_mm=offsets)


def test_the_bench_draws_a_marker_where_it_lies():
    # rays through points a little within and without its edge
    handle, camera = beside(0.2), RIG.cameras[0]
    seen = int((handle.marker_normals @ POSE.inv().apply(camera.centre)).argmax())
    labels = [
        cast(camera, handle, POSE, camera.project(POSE.apply(outline))).labels
        for outline in (marker_outline(handle, seen, 32, scale) for scale in (0.97, 1.03))
    ]
    assert (labels[0] == seen).all()
    assert (labels[1] != seen).all()


@pytest.mark.slow
def test_centres_are_measured_where_the_bench_draws_them():
    handle = beside(0.2)
    frames = render_rig(RIG, handle, POSE, Bench(read_noise=0.0, shot_variance=0.0), rng())
    found = centre_pixels(frames, RIG, handle, POSE, 60.0)
    true = np.stack([camera.project(POSE.apply(handle.marker_centres)) for camera in RIG.cameras])
    assert np.isfinite(found.uv[..., 0]).sum() > 8
    assert np.nanmax(np.abs(found.uv - true)) < 0.02  # px; 0.2 mm are one


@pytest.fixture(scope="module")
def frames():
    """Images of a handle whose markers lie 0.15 mm beside their places, in each direction."""
    return render_rig(RIG, beside(0.15), POSE, Bench(), rng())


def off(frames, handle, estimator):
    """How far an estimator's pose is from the true one, mm and deg; far if there is none."""
    pose = measure(frames, RIG, handle, POSE, Parameters(estimator=estimator)).pose
    if pose.T_world_handle is None:
        return np.array([10.0, 90.0])
    away = motion_between(pose.T_world_handle, POSE)
    return np.array([np.linalg.norm(away[:3]), np.rad2deg(np.linalg.norm(away[3:]))])


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_every_estimator_knows_them(frames, estimator):
    # the paper's centroids are biased
    most = [0.4, 2.5] if estimator.startswith("paper") else [0.03, 0.3]
    knowing = off(frames, beside(0.15), estimator)
    assert (knowing < most).all()
    assert knowing[1] < off(frames, CODED, estimator)[1] / 1.5
