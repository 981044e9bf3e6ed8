"""The paper's numbers and the shipped files: Table 1, calibration, rigs, handles, tables of sweeps
(Sect. 6).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from .camera import Camera, Rig, RigCovariance
from .checks import Array, as_array, as_number
from .files.fetch import RealSet, find, read_real_sets
from .files.inputs import get, read_toml
from .files.rigs import read_handle, read_rig
from .files.shipped import data_path as data_path
from .handle import Handle
from .metrics import pose_from_euler_deg
from .rigid import nearest_rotation

if TYPE_CHECKING:
    import pandas as pd

IMAGE_SIZE = (1280, 1024)  # assumed from the principal points; the paper prints no image size

STANDOFF_MM = 549.0  # of CCD3, as far from the work as CCD1


class Table1(NamedTuple):
    """The twenty poses of Table 1: `measured` and `set_poses` (T_world_handle, mm), and the printed
    numbers.
    """

    measured: RigidTransform
    set_poses: RigidTransform
    frame: pd.DataFrame


class Calibration(NamedTuple):
    """Sect. 6.2 as printed: intrinsic matrices (3, 3) in px, and X_l = R_rl X_r + T_rl (CCD2 to
    CCD1, mm).
    """

    A_l: Array
    A_r: Array
    R_rl: Array
    T_rl: Array


def load_rig(name: str) -> Rig:
    """Load a shipped rig: `paper_pair`, `paper_trinocular`, `raised_40deg`. ValueError for an
    unknown name.
    """
    return read_rig(_named("rigs", name))


def load_handle(name: str) -> Handle:
    """Load a shipped handle: `paper`, `coded`. ValueError for an unknown name."""
    return read_handle(_named("handles", name))


def shipped_handles() -> list[str]:
    """The names of the shipped handles."""
    return _shipped("handles")


def load_table1() -> Table1:
    """Load Table 1: the measured and the set ("theoretic") poses, and the printed numbers as a data
    frame.
    """
    import pandas as pd  # only here: `trinolab.measure` loads without it

    frame = pd.read_csv(data_path("table1.csv"), index_col="no")
    measured, set_poses = (
        pose_from_euler_deg(
            frame[[f"{side}_{c}_mm" for c in "xyz"]],
            frame[[f"{side}_{angle}_deg" for angle in ("alpha", "beta", "gamma")]],
        )
        for side in ("measured", "set")
    )
    return Table1(measured, set_poses, frame)


def load_calibration() -> Calibration:
    """Load the calibration of Sect. 6.2 as printed; for use R_rl goes through
    `nearest_rotation`.
    """
    path = data_path("calibration.toml")
    table = read_toml(path)
    shapes: dict[str, tuple[int, ...]] = {
        "A_l": (3, 3),
        "A_r": (3, 3),
        "R_rl": (3, 3),
        "T_rl": (3,),
    }
    return Calibration(
        *(as_array(get(table, key, str(path)), key, shape) for key, shape in shapes.items())
    )


def load_real_sets() -> dict[str, RealSet]:
    """Entries of the real recordings made by others, by name: origin, licence, files, published
    results.
    """
    return read_real_sets(data_path("real.toml"))


def real_set(name: str, fetch: bool = False) -> Path | None:
    """The folder of a real recording made by others: below TRINOLAB_DATA, or in the cache, or
    fetched into it.

    Parameters
    ----------
    name : str
        `opencv_stereo`, `pymvg_mcsc`, `caliscope`, `trackpy_particles` or `trajectories`.
    fetch : bool
        Fetch the set if it is not here; its licence is shown. Without it nothing ever touches the
        network.

    Returns
    -------
    Path or None
        None if the set is not here. `fetch.why_not` says why.

    Raises
    ------
    ValueError
        For an unknown name, and as `fetch.find` does.
    """
    sets = load_real_sets()
    if name not in sets:
        raise ValueError(f"name: expected one of {', '.join(sets)}, got {name!r}")
    return find(sets[name], fetch)


def paper_rig(elevation_deg: float | None = None) -> Rig:
    """Build the paper's rig from its calibration; the world frame is CCD1's camera frame
    (Sect. 6.2, Fig. 5).

    Parameters
    ----------
    elevation_deg : float, optional
        Elevation of CCD3 above CCD1 on the circle of radius 549 mm about (0, 0, 549) in the plane x
        = 0, looking at the circle's centre; 90 is `paper_trinocular`, 40 `raised_40deg`. None gives
        CCD1 and CCD2 alone: `paper_pair`.

    Raises
    ------
    ValueError
        If the elevation is no number in [-180, 180].
    """
    A_l, A_r, R_rl, T_rl = load_calibration()
    T_ccd1_ccd2 = RigidTransform.from_components(T_rl, nearest_rotation(R_rl))
    cameras = [_camera("ccd1", A_l, RigidTransform.identity()), _camera("ccd2", A_r, T_ccd1_ccd2)]
    if elevation_deg is not None:
        cameras.append(_camera("ccd3", A_l, _ccd3_pose(elevation_deg)))
    # it makes the images as well: nothing of it is off
    return Rig(tuple(cameras), RigCovariance.exact([camera.name for camera in cameras]))


def _ccd3_pose(elevation_deg: float) -> RigidTransform:
    """T_ccd1_ccd3; its columns x, y, z are (1, 0, 0), (0, cos, -sin), (0, sin, cos) of the
    elevation.
    """
    elevation = np.deg2rad(as_number(elevation_deg, "elevation_deg", low=-180.0, high=180.0))
    centre = STANDOFF_MM * np.array([0.0, -np.sin(elevation), 1.0 - np.cos(elevation)])
    return RigidTransform.from_components(centre, Rotation.from_rotvec([-elevation, 0.0, 0.0]))


def _camera(name: str, matrix: Array, T_world_cam: RigidTransform) -> Camera:
    return Camera(name, IMAGE_SIZE, matrix, np.zeros(5), T_world_cam.inv())


def rig_file(what: str | Path) -> Path:
    """The rig file that a word of a command line means: a path, or the name of a shipped one.

    A file or folder of that name takes precedence. Raises ValueError for a name, a word without a
    suffix or a folder, that is neither.
    """
    return _file_meant("rigs", "rig", what)


def handle_file(what: str | Path) -> Path:
    """The handle file that a word of a command line means, as `rig_file`."""
    return _file_meant("handles", "handle", what)


def rig_of(what: Rig | str | Path) -> Rig:
    """The rig that a caller means: a `Rig` itself, a file, or the name of a shipped one, see
    `rig_file`. ValueError for anything else.
    """
    return what if isinstance(what, Rig) else read_rig(rig_file(what))


def handle_of(what: Handle | str | Path) -> Handle:
    """The handle that a caller means, as `rig_of`."""
    return what if isinstance(what, Handle) else read_handle(handle_file(what))


def _file_meant(folder: str, kind: str, what: str | Path) -> Path:
    if not isinstance(what, (str, Path)) or not str(what):
        # without the numbers of a rig
        given = f"a {type(what).__name__}" if isinstance(what, Rig | Handle) else f"{what!r:.60}"
        raise ValueError(
            f"{kind}: expected a file or the name of a shipped one "
            f"({', '.join(_shipped(folder))}), got {given}"
        )
    path = Path(what)
    if path.exists() or path.is_symlink() or path.suffix or len(path.parts) != 1:
        return path
    names = _shipped(folder)
    if str(what) not in names:
        raise ValueError(
            f"{what}: no such file, and no shipped {kind} ({', '.join(names)}){_exchanged(folder, what)}"
        )
    return data_path(folder, f"{what}.toml")


def _exchanged(folder: str, what: str | Path) -> str:
    """A hint if a word names a rig where a handle is expected, or the other way round; else empty."""
    other = "rigs" if folder == "handles" else "handles"
    if str(what) not in _shipped(other):
        return ""
    return f"; it is a shipped {other[:-1]}: likely rig and handle are exchanged"


def _shipped(folder: str) -> list[str]:
    return sorted(path.stem for path in data_path(folder).glob("*.toml"))


def _named(folder: str, name: str) -> Path:
    names = _shipped(folder)
    if name not in names:
        raise ValueError(f"name: expected one of {', '.join(names)}, got {name!r}")
    return data_path(folder, f"{name}.toml")


def load_sweep(name: str) -> pd.DataFrame:
    """A shipped table of ``data/sweeps``. ValueError for an unknown name."""
    import pandas as pd  # only here: `trinolab.measure` loads without it

    return pd.read_csv(data_path("sweeps", f"{name}.csv"))
