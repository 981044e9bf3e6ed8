"""The second renderer: as an instrument it is held against OpenCV's projection, before anything is
measured with it.
"""

import sys
from dataclasses import replace
from importlib.util import find_spec

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from satellites.second import frames, pathtracing, recipe, shapes
from satellites.second.pathtracing import Window, traced
from satellites.second.room import Room, Texture, handle_pieces
from trinolab.bench.scene import scaled
from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.files.recording import open_folder

needs_mitsuba = pytest.mark.skipif(
    find_spec("mitsuba") is None, reason="mitsuba is not here: pip install trinolab[second]"
)

TRUTHS = load_table1().set_poses
PINHOLE = Room(aperture_mm=0.0, surround=0.0, bounces=1, samples=400)
SMALL = Room(samples=4, near_samples=1, far_samples=1)


def glowing(handle, T, index):
    """The handle's pieces with one marker, which shines, and nothing else does."""
    row = float(handle.marker_centres[index, 1])
    column = float(np.rad2deg(handle.marker_angles[index]))
    alone = replace(handle, columns_deg=(column,), rows_mm=((row,),))
    pieces = handle_pieces(alone, T, PINHOLE)
    dark = {name: piece._replace(kind="matt", paint=0.0) for name, piece in pieces.items()}
    glow = Texture(shapes.marker_texture(alone))
    return {**dark, "band": pieces["band"]._replace(kind="lamp", paint=glow)}


def projected_outline(camera, handle, T, index, count=4000):
    """The edge of a marker's image by OpenCV, px, shape (count, 2): a circle on the unrolled side."""
    phi = np.linspace(0, 2 * np.pi, count, endpoint=False)
    half = handle.marker_diameter_mm / 2
    theta = handle.marker_angles[index] + half / handle.radius_mm * np.cos(phi)
    axial = handle.marker_centres[index, 1] + half * np.sin(phi)
    edge = np.column_stack(
        [handle.radius_mm * np.sin(theta), axial, handle.radius_mm * np.cos(theta)]
    )
    world = T.as_matrix()[:3, :3] @ edge.T + T.as_matrix()[:3, 3:]
    pose = camera.T_cam_world
    uv, _ = cv2.projectPoints(
        world.T.copy(), pose.rotation.as_rotvec(), pose.translation, camera.matrix, None
    )
    return uv.reshape(-1, 2)


def area_and_centroid(polygon):
    """By the shoelace formula."""
    after = np.roll(polygon, -1, axis=0)
    cross = polygon[:, 0] * after[:, 1] - after[:, 0] * polygon[:, 1]
    area = cross.sum() / 2
    return abs(area), ((polygon + after) * cross[:, None]).sum(axis=0) / (6 * area)


def traced_marker(camera, handle, T, index, room, margin):
    """The image of a marker that glows, its centroid in pixels of the camera, and its variances."""
    edge = projected_outline(camera, handle, T, index)
    low = np.floor(edge.min(axis=0)).astype(int) - margin
    width, height = (np.ceil(edge.max(axis=0)).astype(int) + margin + 1 - low).tolist()
    window = Window(int(low[0]), int(low[1]), width, height, room.samples)
    (image,) = traced(camera, glowing(handle, T, index), room, [window], seed=3)
    v, u = np.mgrid[:height, :width]
    uv = np.stack([u, v]) + low[:, None, None]
    share = image / image.sum()
    middle = (share * uv).sum(axis=(1, 2))
    return image, middle, (share * (uv - middle[:, None, None]) ** 2).sum(axis=(1, 2))


def facing(camera, handle, T, steepest_deg):
    """Markers whose normals are turned towards a camera, by hand."""
    R, t = T.as_matrix()[:3, :3], T.as_matrix()[:3, 3]
    way = camera.centre - (handle.marker_centres @ R.T + t)
    cosine = ((handle.marker_normals @ R.T) * way).sum(axis=1) / np.linalg.norm(way, axis=1)
    return np.flatnonzero(cosine > np.cos(np.deg2rad(steepest_deg)))


@needs_mitsuba
@pytest.mark.parametrize("handle_name", ["paper", "coded"])
@pytest.mark.parametrize("camera", recipe.four_cameras().cameras, ids=lambda camera: camera.name)
def test_glowing_markers_lie_where_opencv_projects_them(camera, handle_name):
    """Through a pinhole a marker's image is the inside of its projected edge: centroid and area."""
    handle = load_handle(handle_name)
    T = TRUTHS[{"ccd1": 0, "ccd2": 5, "above": 9, "raised": 14}[camera.name]]
    apart = []
    for index in facing(camera, handle, T, 60)[:3]:
        area, centre = area_and_centroid(projected_outline(camera, handle, T, index))
        image, found, _ = traced_marker(camera, handle, T, index, PINHOLE, margin=1)
        apart.append(np.abs(found - centre).max())
        assert image.max() == pytest.approx(1.0, abs=1e-3)
        assert image.sum() == pytest.approx(area, rel=0.005)
    assert max(apart) < 0.006  # px; 400 paths a pixel scatter by 0.001


@needs_mitsuba
def test_a_lens_moves_no_marker_and_blurs_by_its_circle_of_confusion():
    """A marker 60 mm behind the sharp plane: the lens adds a disc's variance, r^2 / 4, to the
    pinhole's in each direction, and leaves the centroid.
    """
    camera, handle = recipe.four_cameras().cameras[0], load_handle("coded")
    T = RigidTransform.from_components([0, 0, 565.0], Rotation.from_euler("Y", 180, degrees=True))
    (index,) = facing(camera, handle, T, 12)[:1]
    lens = replace(PINHOLE, aperture_mm=2.0, focus_mm=500.0)
    depth = float(camera.T_cam_world.apply(T.apply(handle.marker_centres))[index, 2])
    radius_px = camera.focal.mean() * 2.0 * (depth - 500.0) / (depth * 500.0)
    (_, sharp, narrow), (_, soft, wide) = (
        traced_marker(camera, handle, T, index, room, margin=6) for room in (PINHOLE, lens)
    )
    assert radius_px > 1.1
    np.testing.assert_allclose(soft, sharp, atol=0.01)  # px
    np.testing.assert_allclose(wide - narrow, radius_px**2 / 4, rtol=0.1)


def test_grey_levels_of_a_sensor_by_hand():
    """Grey 100 is 2,000 electrons: Poisson's variance and 25 electrons of reading, in grey levels
    100 / 20 + (25 / 20)^2, and 1 / 12 of rounding.
    """
    grey = frames.exposed(np.ones((200, 200)), Room(), np.random.default_rng(0)).astype(float)
    assert grey.mean() == pytest.approx(100, abs=0.1)
    assert grey.var() == pytest.approx(100 / 20 + (25 / 20) ** 2 + 1 / 12, rel=0.03)
    assert frames.exposed(np.full((2, 2), 9.0), Room(), np.random.default_rng(0)).min() == 255


def test_dark_markers_change_places_with_the_body():
    dark = replace(load_handle("coded"), markers="dark")
    paints = {
        name: handle_pieces(handle, TRUTHS[0], Room())["band"].paint.values
        for name, handle in (("bright", load_handle("coded")), ("dark", dark))
    }
    np.testing.assert_allclose(paints["bright"] + paints["dark"], 0.75 + 0.16, atol=1e-6)


def test_texture_holds_the_markers_areas():
    """Twelve discs of 3 mm on 31.4 mm by the band's length."""
    handle = load_handle("coded")
    low, high = shapes.band(handle)
    whole = 2 * np.pi * handle.radius_mm * (high - low)
    share = shapes.marker_texture(handle).mean()
    assert share * whole == pytest.approx(12 * np.pi * 1.5**2, rel=1e-3)


@pytest.mark.parametrize(
    "mesh",
    [
        shapes.tube(5.0, -3.0, 8.0),
        shapes.disc(5.0, 2.0, up=True),
        shapes.disc(5.0, 2.0, up=False),
        shapes.panel((1, 2, 3), (4, 0, 0), (0, 0, 5)),
        shapes.capsule((1, 2, 3), (-4, 9, 3), 2.0),
    ],
    ids=["tube", "disc up", "disc down", "panel", "capsule"],
)
def test_faces_turn_the_way_of_their_normals(mesh):
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    normal = mesh.normals[mesh.faces].mean(axis=1)
    area = np.linalg.norm(across, axis=1)
    real = area > 1e-9  # a capsule has faces without area at its ends
    assert real.mean() > 0.9
    assert ((across * normal).sum(axis=1)[real] > 0).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0)


def test_a_capsule_is_at_its_radius_from_the_segment():
    start, end = np.array([1.0, 2.0, 3.0]), np.array([-4.0, 9.0, 3.0])
    points = shapes.capsule(start, end, 2.0).points
    along = np.clip((points - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
    nearest = start + along[:, None] * (end - start)
    np.testing.assert_allclose(np.linalg.norm(points - nearest, axis=1), 2.0)


# --- the recipe


def test_the_third_set_shares_no_pose_and_no_light_with_the_second():
    shootings = recipe.recordings()
    assert len({shooting.number for shooting in shootings.values()}) == len(shootings)
    assert recipe.by_rig(list("abcd"), "raised_40deg") == ["a", "b", "d"]
    for handle in recipe.HANDLES:
        stills, third = shootings[f"stills-{handle}"], shootings[f"third-{handle}"]
        places = np.concatenate([one.truth.translation for one in (stills, third)])
        assert len(np.unique(places, axis=0)) == 60
        first = stills.truth[:20].as_matrix()
        np.testing.assert_array_equal(first, TRUTHS.as_matrix())
        assert stills.room.seed != third.room.seed
        assert stills.room.lamp / stills.room.second_lamp > 1
        assert third.room.lamp / third.room.second_lamp < 1


def tiny():
    """Two instants of small cameras, few paths."""
    still = recipe.stills("coded")
    cameras = tuple(scaled(camera, 0.125) for camera in still.rig.cameras[:2])
    return still._replace(
        rig=Rig(cameras),
        poses=still.poses[:2],
        truth=still.truth[:2],
        gains=still.gains[:2],
        times_s=still.times_s[:2],
        room=SMALL,
    )


@needs_mitsuba
def test_a_recording_that_was_stopped_goes_on_to_the_same_files(tmp_path, monkeypatch):
    recipe.write_recording(tiny(), tmp_path / "whole", progress=False)
    taken = []

    def stopping(shooting, frame):
        if frame == 1 and not taken:
            taken.append(frame)
            raise KeyboardInterrupt
        return recipe_instant(shooting, frame)

    recipe_instant = recipe.instant
    monkeypatch.setattr(recipe, "instant", stopping)
    with pytest.raises(KeyboardInterrupt):
        recipe.write_recording(tiny(), tmp_path / "parted", progress=False)
    assert not (tmp_path / "parted").exists()
    other = tiny()._replace(room=replace(SMALL, lamp=1.0))
    with pytest.raises(ValueError, match="an unfinished recording with another room"):
        recipe.write_recording(other, tmp_path / "parted", progress=False)
    recipe.write_recording(tiny(), tmp_path / "parted", progress=False)
    names = {p.relative_to(tmp_path / "whole") for p in (tmp_path / "whole").rglob("*.*")}
    assert names == {p.relative_to(tmp_path / "parted") for p in (tmp_path / "parted").rglob("*.*")}
    for name in names:
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "parted" / name).read_bytes()
    recording, handle = open_folder(tmp_path / "whole")
    assert handle == load_handle("coded")
    assert recording.length == 2
    assert recording.rig.names == ("ccd1", "ccd2")


@needs_mitsuba
def test_a_lens_that_distorts_is_refused():
    camera = replace(load_rig("paper_pair").cameras[0], distortions=[0.1, 0, 0, 0, 0])
    with pytest.raises(ValueError, match="camera ccd1: expected no distortion, got "):
        traced(camera, {}, SMALL, [], 0)


def test_without_mitsuba_one_line_says_what_is_missing(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    pathtracing.mitsuba.cache_clear()
    with pytest.raises(ValueError, match=r"mitsuba: not installed; .*trinolab\[second\]"):
        recipe.write_recording(tiny(), tmp_path / "out")
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("field", "value"),
    [("aperture_mm", -1.0), ("roughness", 0.0), ("samples", 1.5), ("marker_reflectance", 1.1)],
)
def test_a_room_that_cannot_be_is_refused(field, value):
    with pytest.raises(ValueError, match=f"{field}: expected "):
        Room(**{field: value})
