"""The Cramer-Rao bound against the information of edges in closed form, and against what its noise
model draws.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import eigh
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import norm

from trinolab.bench.optics import Bench
from trinolab.bench.rays import marker_outline
from trinolab.camera import Camera, Rig
from trinolab.datasets import load_sweep
from trinolab.handle import Handle
from workbench.studies import bound
from workbench.studies.bound import Bound, bound_of, information, mean_length

# four markers in the middle of a thick body, far from its outline
WIDE = Handle("wide", 15.0, 200.0, 25.0, 3.0, (-20.0, 20.0), ((10.0, -10.0), (6.0, -14.0)))
T = RigidTransform.from_components(
    [10.0, -15.0, 540.0], Rotation.from_euler("ZYX", [70, -170, 15], degrees=True)
)
MATRIX = np.array([[2956.2, 0, 628], [0, 2940.1, 515], [0, 0, 1]])
FLAT = Bench(shading=0.0)  # brightness tells nothing of the pose: only the edges do


def camera(name, distortions, T_world_cam):
    """A camera whose image is cut down to the surroundings of the handle's markers."""
    whole = Camera(name, (1280, 1024), MATRIX, distortions, T_world_cam.inv())
    corner = np.round(whole.project(T.translation[None])[0]) - 150
    return replace(
        whole, size=(300, 300), matrix=MATRIX - [[0, 0, corner[0]], [0, 0, corner[1]], [0, 0, 0]]
    )


FRONT = camera("front", [-0.25, 0.12, 0.001, -0.0008, 0.02], RigidTransform.identity())
SIDE = camera(
    "side",
    np.zeros(5),
    RigidTransform.from_components(
        [200.0, 0.0, 70.0], Rotation.from_rotvec([0, np.deg2rad(-20), 0])
    ),
)
RIG = Rig((FRONT, SIDE))


def moved(pose, step):
    return RigidTransform.from_components(
        pose.translation + step[:3], Rotation.from_rotvec(step[3:]) * pose.rotation
    )


def edge_information(camera, handle, bench, tiny=1e-4):
    """Of blurred edges, no image made: the sum over the outline of ds (n . dx/dp)^2 int g(x)^2 /
    variance dx.
    """
    sigma = np.hypot(bench.blur_px, np.sqrt(1 / 12))  # lens and pixel
    step = bench.marker_grey - bench.body_grey

    def density(x):
        grey = bench.body_grey + step * norm.cdf(x, 0, sigma)
        return norm.pdf(x, 0, sigma) ** 2 / (1.5**2 + 1 / 12 + 0.05 * grey)

    across = step**2 * quad(density, -6, 6)[0]
    F = np.zeros((6, 6))
    for k in range(len(handle.marker_centres)):
        outline = marker_outline(handle, k, 720)
        uv = camera.project(T.apply(outline))
        tangent = (np.roll(uv, -1, axis=0) - np.roll(uv, 1, axis=0)) / 2
        length = np.linalg.norm(tangent, axis=1)
        normal = tangent[:, ::-1] * [1, -1] / length[:, None]
        speeds = [
            ((camera.project(moved(T, d).apply(outline)) - uv) / tiny * normal).sum(axis=1)
            for d in tiny * np.eye(6)
        ]
        F += across * np.einsum("in,jn,n->ij", speeds, speeds, length)
    return F


@pytest.mark.heavy
def test_information_is_that_of_the_markers_edges():
    """The whole matrix: no mixture of parameters is worth more or less than it should be.

    The closed form takes the edges for straight (radius 7.5 px, blur 0.76: 1 %); the noise of a
    derivative adds a few per cent in the mixture that the images determine least.
    """
    ours = sum(information(camera, WIDE, T, FLAT) for camera in RIG.cameras)
    edges = sum(edge_information(camera, WIDE, FLAT) for camera in RIG.cameras)
    ratios = eigh(ours, edges, eigvals_only=True)
    assert ratios.min() > 0.97
    assert ratios.max() < 1.15
    assert bound_of(ours).rms_mm == pytest.approx(bound_of(edges).rms_mm, rel=0.04)
    assert bound_of(ours).rms_deg == pytest.approx(bound_of(edges).rms_deg, rel=0.04)


def test_handle_out_of_sight_has_no_bound():
    away = RigidTransform.from_translation([0, 0, -600.0])
    nothing = information(FRONT, WIDE, away)
    assert (nothing == 0).all()
    none = bound_of(nothing)
    assert np.isnan([none.rms_mm, none.rms_deg, none.mean_mm, none.mean_deg]).all()


def test_means_of_gaussian_lengths():
    """E |x| is sqrt(8 / pi) sigma in three dimensions, sqrt(pi / 2) in two, sqrt(2 / pi) in one;
    else drawn.
    """
    for n, factor in ((3, np.sqrt(8 / np.pi)), (2, np.sqrt(np.pi / 2)), (1, np.sqrt(2 / np.pi))):
        assert mean_length(np.diag(([0.04] * n + [0.0] * 3)[:3])) == pytest.approx(
            0.2 * factor, rel=1e-6
        )
    A = np.random.default_rng(0).standard_normal((3, 3)) * [1e-3, 2e-4, 1e-2]
    drawn = np.linalg.norm(np.random.default_rng(1).standard_normal((400_000, 3)) @ A, axis=1)
    # of a mean of 400,000: 1e-3
    assert mean_length(A.T @ A) == pytest.approx(drawn.mean(), rel=4e-3)
    assert mean_length(np.zeros((3, 3))) == 0.0
    C = np.diag([9.0, 16, 0, 1e-6, 0, 0])
    assert (Bound(C).rms_mm, Bound(C).rms_deg) == (5.0, pytest.approx(np.rad2deg(1e-3)))
    assert Bound(C).mean_deg == pytest.approx(np.rad2deg(1e-3 * np.sqrt(2 / np.pi)))


def test_the_shipped_table_has_every_pose_and_a_third_camera_or_more_pixels_take_nothing_away():
    table = load_sweep("bound").set_index(["rig", "pixels", "row"])
    places = product(bound.RIGS, bound.SHIPPED_PIXELS, range(1, 21))
    assert list(table.index) == list(places)
    assert (table > 0).all(axis=None)
    rms = table[["rms_mm", "rms_deg"]]
    for three in bound.RIGS[1:]:
        assert (rms.loc[three] < rms.loc["paper_pair"]).all(axis=None)
    markers, around = (rms.xs(pixels, level="pixels") for pixels in bound.SHIPPED_PIXELS)
    assert (around < 1.001 * markers).all(axis=None)


# --- the parts, quickly: on a few pixels, or without an image


def test_what_is_left_to_know_of_a_pose_is_the_inverse_s_corner():
    """The covariance of the first six, whatever the others are."""
    J = np.random.default_rng(2).normal(size=(30, 8))
    F = J.T @ J
    np.testing.assert_allclose(
        np.linalg.inv(bound.marginal(F)), np.linalg.inv(F)[:6, :6], rtol=1e-9
    )
    np.testing.assert_array_equal(bound.marginal(F[:6, :6]), F[:6, :6])


@pytest.fixture
def small(monkeypatch):
    """A window around one marker, a sample a pixel."""
    monkeypatch.setattr(bound, "SAMPLES", (2, 1))
    (uv,) = FRONT.project(T.apply(WIDE.marker_centres[:1]))
    u, v = np.round(uv) - 12
    return replace(FRONT, size=(25, 25), matrix=FRONT.matrix - [[0, 0, u], [0, 0, v], [0, 0, 0]])


def test_information_of_a_few_pixels_is_a_covariance_s_inverse(small):
    """And less where the greys are not known."""
    bench = replace(FLAT, supersampling=1, marker_supersampling=2)
    known, unknown = (
        information(small, WIDE, T, bench, "handle", known_greys=known) for known in (True, False)
    )
    scale = np.sqrt(known.diagonal())
    for F in (known, known - unknown):
        np.testing.assert_allclose(F, F.T, atol=1e-9 * np.abs(F).max())
        assert np.linalg.eigvalsh(F / np.outer(scale, scale)).min() > -1e-9
    assert np.trace(unknown / np.outer(scale, scale)) < 6 - 1e-4
