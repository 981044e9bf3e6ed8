"""The stored recipe: two sets of sixty instants of a handle at rest, and a short film, as recording
folders.

The four cameras are those of the shipped rigs: CCD1, CCD2, and CCD3 above the work and at 40 deg. A
frame follows from the recipe's seed, its number and its camera, so that a rendering can stop and go
on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from tqdm import tqdm

from trinolab.camera import Camera, Rig, RigCovariance
from trinolab.checks import Array
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.files.journal import locked
from trinolab.files.poses import truth_table
from trinolab.files.recording_writer import add, begin, claim, finish, image_paths, partial_of
from trinolab.handle import Handle, slants
from workbench.provenance import code_hash, hash_function

from .frames import exposed, plate, take
from .pathtracing import mitsuba
from .room import Room

SEED = 2026
HANDLES = ("paper", "coded")
# The cameras of each shipped rig among the four, in its order.
RIGS = {"paper_pair": (0, 1), "paper_trinocular": (0, 1, 2), "raised_40deg": (0, 1, 3)}
RANDOM_POSES = 10  # a handle, beside the twenty of Table 1
SHARED = 4  # markers that CCD1 and CCD2 both see at a random pose
FILM_RIG, FILM_HANDLE = "raised_40deg", "coded"
FILM_FRAMES, FPS = 24, 30.0
EXPOSURE_S, MOMENTS = 0.004, 6  # of a frame of the film
FILM_ROOM = Room(samples=36 * MOMENTS, near_samples=4 * MOMENTS, far_samples=MOMENTS)
LIGHT_AFTER, LIGHT_STEP = 1.3, 12  # the light's factor from this frame on
# The third set of frames judges what was chosen on the others: other lights, varnish, paint, lens,
# sensor and textures, and other poses. It was stored before anything was measured on it.
THIRD_POSES = 30
THIRD_ROOM = Room(
    seed=53,
    aperture_mm=2.0,
    focus_mm=590.0,
    marker_reflectance=0.6,
    body_reflectance=0.1,
    roughness=0.15,
    lamp=60.0,
    second_lamp=190.0,
    surround=1.0,
    electrons_per_grey=12.0,
)
_STEEPEST_DEG, _MARGIN_PX = 62.0, 10.0  # of a marker that a camera truly sees


class Shooting(NamedTuple):
    """A recording to make.

    Attributes
    ----------
    rig : Rig
    handle : Handle
    poses : list of RigidTransform
        T_world_handle at the moments of each exposure, evenly spaced: batches of an odd length, or
        of one.
    truth : RigidTransform
        At mid-exposure of each frame.
    gains : list of float
        The light of each frame.
    times_s : ndarray
        Of mid-exposure, s.
    held : bool
        Whether a gloved hand holds the handle.
    number : int
        Of the recording in the recipe.
    """

    rig: Rig
    handle: Handle
    poses: list[RigidTransform]
    truth: RigidTransform
    gains: list[float]
    times_s: Array
    held: bool
    number: int
    room: Room = Room()


def four_cameras() -> Rig:
    """CCD1, CCD2, and CCD3 in both of its places: ``above`` and ``raised``."""
    left, right, above = load_rig("paper_trinocular").cameras
    raised = load_rig("raised_40deg").cameras[2]
    cameras = (left, right, replace(above, name="above"), replace(raised, name="raised"))
    return Rig(cameras, RigCovariance.exact([camera.name for camera in cameras]))


def stills(handle_name: str) -> Shooting:
    """Thirty instants of a handle at rest: Table 1's twenty poses and ten random ones."""
    number = HANDLES.index(handle_name)
    drawn = _random_poses(handle_name, number, RANDOM_POSES)
    return _at_rest(handle_name, number, [*load_table1().set_poses, *drawn], Room())


def third_set(handle_name: str) -> Shooting:
    """Thirty instants of a handle at rest, in other light and at other poses than `stills`."""
    number = 1 + len(HANDLES) + HANDLES.index(handle_name)
    poses = _random_poses(handle_name, number, THIRD_POSES)
    return _at_rest(handle_name, number, poses, THIRD_ROOM)


def _random_poses(handle_name: str, number: int, count: int) -> list[RigidTransform]:
    """The random poses of a recording, by its number."""
    handle, rng = load_handle(handle_name), np.random.default_rng([SEED, number])
    return [_random_pose(handle, rng) for _ in range(count)]


def _at_rest(
    handle_name: str, number: int, poses: Sequence[RigidTransform], room: Room
) -> Shooting:
    """A handle that rests at one pose after the other, in steady light."""
    return Shooting(
        four_cameras(),
        load_handle(handle_name),
        [RigidTransform.concatenate([T]) for T in poses],
        RigidTransform.concatenate(list(poses)),
        [1.0] * len(poses),
        np.arange(len(poses), dtype=float),
        False,
        number,
        room,
    )


def film() -> Shooting:
    """A gloved hand moves the coded handle; at half of the time the light gets brighter."""
    times = np.arange(FILM_FRAMES) / FPS
    open_s = EXPOSURE_S * ((np.arange(MOMENTS) + 0.5) / MOMENTS - 0.5)
    gains = [LIGHT_AFTER if k >= LIGHT_STEP else 1.0 for k in range(FILM_FRAMES)]
    return Shooting(
        load_rig(FILM_RIG),
        load_handle(FILM_HANDLE),
        [motion(t + open_s) for t in times],
        motion(times),
        gains,
        times,
        True,
        len(HANDLES),
        FILM_ROOM,
    )


def motion(times_s: Array) -> RigidTransform:
    """Where the film's handle is, T_world_handle: up to 0.4 m/s and 90 deg/s."""
    t = np.asarray(times_s)[:, None]
    places = np.array([0.0, 0.0, 570.0]) + [50.0, 30.0, 25.0] * np.sin(
        np.array([6.0, 4.5, 5.0]) * t + [0.3, 1.2, 2.0]
    )
    turns = [0.35, 0.2, 0.6] * np.sin(np.array([3.0, 3.7, 2.1]) * t + [0.5, 1.9, 0.2])
    upright = Rotation.from_euler("Z", 160, degrees=True)
    return RigidTransform.from_components(places, Rotation.from_rotvec(turns) * upright)


def write_recording(shooting: Shooting, out: str | Path, progress: bool = True) -> None:
    """Render a recording folder with its truth; interrupted and called again, it goes on.

    Parameters
    ----------
    shooting : Shooting
    out : path
        The folder to write. Until it is whole, all is in the folder ``<out>.partial`` beside it.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Raises
    ------
    ValueError
        If Mitsuba is not installed, the folder exists already, cannot be written or was begun with
        another recipe, or another process works on it.
    """
    mitsuba()
    partial = partial_of(out)
    rig, room = shooting.rig, shooting.room
    try:
        partial.mkdir(exist_ok=True)
    except OSError as error:
        raise ValueError(f"{partial}: cannot be written ({error.strerror})") from None
    with locked(partial):
        claim(partial, made_from(shooting))
        empty = {
            camera.name: exposed(plate(camera, room), room, _random(shooting, 0, k))
            for k, camera in enumerate(rig.cameras)
        }
        begin(out, rig, shooting.handle, empty)
        frames = range(len(shooting.poses))
        for frame in tqdm(frames, unit="instant", disable=None if progress else True):
            if not all(path.is_file() for path in image_paths(partial, rig, frame)):
                add(partial, rig, frame, instant(shooting, frame))
        truth = truth_table(shooting.truth).assign(t_s=shooting.times_s)
        counts = np.array(
            [[seen_markers(c, shooting.handle, T) for c in rig.cameras] for T in shooting.truth]
        )
        truth = truth.assign(markers=counts.max(axis=1), cameras=(counts > 0).sum(axis=1))
        finish(out, list(shooting.times_s), truth)


def instant(shooting: Shooting, frame: int) -> list[np.ndarray]:
    """The frames of one instant, uint8, one per camera."""
    return [
        take(
            camera,
            shooting.handle,
            list(shooting.poses[frame]),
            shooting.room,
            _random(shooting, 1 + frame, k),
            shooting.gains[frame],
            shooting.held,
        )
        for k, camera in enumerate(shooting.rig.cameras)
    ]


def made_from(shooting: Shooting) -> dict[str, Any]:
    """All that decides what is in a recording, short: for its manifest, and to find it again."""
    parts = {
        "cameras": [
            [c.name, c.size, c.matrix.tolist(), c.T_cam_world.as_matrix().tolist()]
            for c in shooting.rig.cameras
        ],
        "handle": asdict(shooting.handle),
        "room": asdict(shooting.room),
        "instants": [T.as_matrix().tolist() for T in shooting.poses],
        "light": [shooting.gains, list(shooting.times_s), shooting.held],
        # of what makes the images: rendering takes an hour, and no estimator changes it
        "code": [code_hash(take.__module__), hash_function(instant)],
    }
    short = {
        name: hashlib.sha256(json.dumps(part).encode()).hexdigest()[:16]
        for name, part in parts.items()
    }
    return {"recording": shooting.number, "seed": SEED, "frames": len(shooting.poses), **short}


def seen_markers(camera: Camera, handle: Handle, T_world_handle: RigidTransform) -> int:
    """How many markers a camera truly sees; neither body nor glove hides one that is turned to it."""
    return int(_seen(camera, handle, T_world_handle).sum())


def _seen(camera: Camera, handle: Handle, T: RigidTransform) -> np.ndarray:
    turned = slants(handle, T, camera.centre) <= np.deg2rad(_STEEPEST_DEG)
    radius_px = float(camera.focal.max()) * handle.marker_diameter_mm / 2 / 500.0  # 500 mm away
    return turned & camera.sees(T.apply(handle.marker_centres), _MARGIN_PX + radius_px)


def _random_pose(handle: Handle, rng: np.random.Generator) -> RigidTransform:
    """A pose T_world_handle in the common field of view, its axis across the line of sight."""
    left, right = four_cameras().cameras[:2]
    while True:
        place = np.array([0.0, 0.0, 570.0]) + [80.0, 55.0, 50.0] * rng.uniform(-1, 1, 3)
        lean, roll, turn = rng.uniform([-30, -180, -180], [30, 180, 180])
        rotation = Rotation.from_euler("ZXY", [roll, lean, turn], degrees=True)
        T = RigidTransform.from_components(place, rotation)
        if (_seen(left, handle, T) & _seen(right, handle, T)).sum() >= SHARED:
            return T


def _random(shooting: Shooting, number: int, camera: int) -> np.random.Generator:
    return np.random.default_rng([SEED, 10 + shooting.number, number, camera])


@cache
def recordings() -> dict[str, Shooting]:
    """All of the recipe, by the names of their folders."""
    return {
        **{f"stills-{name}": stills(name) for name in HANDLES},
        **{f"third-{name}": third_set(name) for name in HANDLES},
        "film": film(),
    }


def rigs() -> dict[str, Rig]:
    """The shipped rigs of `RIGS`, as parts of the four cameras."""
    every = four_cameras()
    return {name: every.part(chosen) for name, chosen in RIGS.items()}


def by_rig(images: Sequence[np.ndarray], rig_name: str) -> list[np.ndarray]:
    """The images of a shipped rig's cameras, of those of the four."""
    return [images[k] for k in RIGS[rig_name]]
