"""Exercises of chapter 2: the workspace."""

from __future__ import annotations

import numpy as np

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


def in_pyramid(p, T_cam_world, matrix, size):
    """Say whether a camera without distortion sees a point.

    Parameters
    ----------
    p
        (3,), the point in the world frame, mm.
    T_cam_world
        (4, 4), takes coordinates of the world to those of the camera.
    matrix
        (3, 3), the camera matrix, px.
    size
        Width and height of the image, px. Pixel (0, 0) is the centre of the top-left pixel.

    Returns
    -------
    bool
        Whether the point lies before the camera and is projected into the image, which ends at the
        outer edges of its pixels.
    """
    T_cam_world = np.asarray(T_cam_world)
    x, y, z = T_cam_world[:3, :3] @ p + T_cam_world[:3, 3]
    if z <= 0:
        return False
    u, v, w = np.asarray(matrix) @ [x, y, z]
    width, height = size
    return bool(-0.5 <= u / w <= width - 0.5 and -0.5 <= v / w <= height - 0.5)


def _turned(degrees, about, shift):
    """A rigid motion (4, 4): a turn about an axis of the frame, and a shift."""
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler(about, degrees, degrees=True).as_matrix()
    T[:3, 3] = shift
    return T


def _pyramid_cases(rng):
    """Points beside each edge of the image, behind the camera, and well inside, of three cameras."""
    matrix = np.array([[2900.0, 0.0, 640.0], [0.0, 2950.0, 500.0], [0.0, 0.0, 1.0]])
    size = (1280, 1024)
    inside = [(640.0, 500.0, 550.0), (-0.3, 300.0, 500.0), (1279.3, 900.0, 600.0)]
    outside = [(-0.8, 300.0, 500.0), (1280.2, 400.0, 550.0), (1100.0, 1023.8, 600.0)]
    places = [*inside, *outside, (700.0, 400.0, -550.0), (1150.0, 1010.0, 520.0)]
    poses = [
        np.eye(4),
        _turned(30.0, "y", [-40.0, 10.0, 25.0]),
        _turned(75.0, "x", rng.uniform(-50, 50, 3)),
        _turned(2.0, "z", [60.0, 0.0, 20.0]),
    ]
    cases = []
    for T in poses:
        for u, v, z in places:
            in_camera = z * np.linalg.solve(matrix, [u, v, 1.0])
            world = np.linalg.solve(T, [*in_camera, 1.0])[:3]
            cases.append((world, T, matrix, size))
    return cases


def _pyramid(p, T, matrix, size, low=-0.5, high=0.5, order=(0, 1), behind=False):
    x, y, z = T[:3, :3] @ p + T[:3, 3]
    if z <= 0 and not behind:
        return False
    u, v, w = matrix @ [x, y, z]
    ends = np.array([size[order[0]], size[order[1]]]) - high
    return bool(low <= u / w <= ends[0] and low <= v / w <= ends[1])


def _behind_as_well(p, T_cam_world, matrix, size):
    return _pyramid(p, T_cam_world, matrix, size, behind=True)


def _other_way(p, T_cam_world, matrix, size):
    return _pyramid(p, np.linalg.inv(T_cam_world), matrix, size)


def _transposed(p, T_cam_world, matrix, size):
    T = np.array(T_cam_world)
    T[:3, :3] = T[:3, :3].T
    return _pyramid(p, T, matrix, size)


def _size_swapped(p, T_cam_world, matrix, size):
    return _pyramid(p, T_cam_world, matrix, size, order=(1, 0))


def _from_zero(p, T_cam_world, matrix, size):
    return _pyramid(p, T_cam_world, matrix, size, low=0.0, high=0.0)


def _centres(p, T_cam_world, matrix, size):
    return _pyramid(p, T_cam_world, matrix, size, low=0.0, high=1.0)


LARGER = ("larger", "the same", "smaller")

EXERCISES = (
    ValueExercise(
        "02.1",
        "pencil",
        "Membership by hand",
        "ex-workspace-membership",
        2,
        (
            Mistake(
                "This is the cosine of the angle. Take its arccos, in deg.",
                "2, One cone, one point",
                {"ccd1_deg": 0.990},
            ),
            Mistake(
                "The angle is in rad. Degrees are asked for.",
                "2, One cone, one point",
                {"ccd1_deg": 0.1405},
            ),
            Mistake(
                "This is the angle from the Z axis of OXYZ. CCD1's axis lies at 45 deg to it.",
                "2, Derivation",
                {"ccd1_deg": 45.562},
            ),
            Mistake(
                "This is the angle between p itself and CCD3's axis. The vector begins at the apex: "
                "take p - q.",
                "2, One cone, one point",
                {"ccd3_deg": 98.05},
            ),
            Mistake(
                "CCD3 looks along -Y, towards the point. 180 deg would be a point behind it.",
                "2, Derivation",
                {"ccd3_deg": 180.0},
            ),
        ),
        {
            "ccd1_deg": Asked(8.05, "deg", within=0.15),
            "ccd3_deg": Asked(0.0, "deg", within=0.05),
            "inside": Asked("yes", choices=("yes", "no")),
        },
    ),
    ValueExercise(
        "02.2",
        "pencil",
        "How much do the corners cost?",
        "ex-workspace-corners",
        2,
        (
            Mistake(
                "This circle touches the sides of the square from inside, so that its corners are "
                "left out. The cone has to hold the whole image.",
                "2, The calibrated cameras",
                {"square": np.pi / 4},
            ),
            Mistake(
                "The circle's radius is half of the diagonal, not the whole of it.",
                "2, The calibrated cameras",
                {"square": 2 * np.pi},
            ),
            Mistake(
                "You have divided the other way round: how much larger is the circle?",
                "2, The calibrated cameras",
                {"square": 2 / np.pi},
            ),
            Mistake(
                "The rectangle's factor is larger than the square's: of all rectangles in a circle "
                "the square fills most of it.",
                "2, The calibrated cameras",
                {"rectangle": np.pi / 2},
            ),
        ),
        {
            "square": Asked(np.pi / 2, within=0.01),
            "rectangle": Asked(np.pi * (1280**2 + 1024**2) / (4 * 1280 * 1024), within=0.008),
        },
    ),
    FunctionExercise(
        "02.3",
        "write",
        "A pyramid",
        "ex-workspace-pyramid",
        4,
        (
            Mistake(
                "Points behind the camera are let through. They project into the image as well: "
                "look at the sign of z first.",
                "2, One cone, one point",
                _behind_as_well,
            ),
            Mistake(
                "The motion is used the other way round: T_cam_world takes the world's coordinates "
                "to the camera's, and its inverse does not.",
                "2, The calibrated cameras",
                _other_way,
            ),
            Mistake(
                "The rotation is transposed.",
                "2, Derivation",
                _transposed,
            ),
            Mistake(
                "Width and height are swapped: u runs along the width, v along the height.",
                "2, The calibrated cameras",
                _size_swapped,
            ),
            Mistake(
                "Half a pixel: (0, 0) is the centre of the top-left pixel. So the image begins at "
                "-0.5 and ends at width - 0.5.",
                "2, Exercises",
                _from_zero,
            ),
            Mistake(
                "This lets in what lies between the centres of the outermost pixels. The image ends "
                "at their outer edges, half a pixel further out.",
                "2, Exercises",
                _centres,
            ),
        ),
        in_pyramid,
        _pyramid_cases,
    ),
    ValueExercise(
        "02.4",
        "predict",
        "More parallel",
        "ex-workspace-change",
        3,
        (
            Mistake(
                "The axes meet over the middle of the baseline: it is half of B that counts.",
                "2, Derivation",
                {"meet_B": np.tan(np.deg2rad(75))},
            ),
            Mistake(
                "This is the cotangent. The angle lies at the baseline, and the height is opposite "
                "to it.",
                "2, Derivation",
                {"meet_B": 0.5 / np.tan(np.deg2rad(75))},
            ),
            Mistake(
                "Axes that are more parallel meet farther away, and there the cones are wider.",
                "2, What happens if the lenses are wider, or the cameras more parallel?",
                {"volume": "smaller"},
            ),
            Mistake(
                "This is the volume for 45 deg. Change the parameter, and run the chapter again from "
                "its first cell.",
                "2, How large is it?",
                {"volume_B3": 0.0715},
            ),
            Mistake(
                "This is the count for 45 deg. Look at the line of the table for 75 deg.",
                "2, What the volume does not say",
                {"poses": 5.0},
            ),
            Mistake(
                "The last table has the errors of the calibrated rig. The ideal cones' angle does not "
                "occur in them.",
                "2, The whole chain in this workspace",
                {"stays": "the volume"},
            ),
        ),
        {
            "meet_B": Asked(np.tan(np.deg2rad(75)) / 2, "B", within=0.01),
            "volume": Asked("larger", choices=LARGER),
            "volume_B3": Asked(1.6856, "B^3", within=0.005),
            "poses": Asked(20.0, within=0.1),
            "stays": Asked("the errors", choices=("the volume", "the poses", "the errors")),
        },
    ),
    ValueExercise(
        "02.5",
        "project",
        "Where to put CCD3",
        "ex-workspace-project",
        5,
        (
            Mistake(
                "CCD1 and CCD2 share four markers in all twenty poses, wherever CCD3 stands. Count "
                "what CCD3 shares with one of them.",
                "2, What the volume does not say",
                {"poses_40": 20.0, "poses_90": 20.0},
            ),
            Mistake(
                "These are the volumes of the cones around the fields of view. The true pyramids "
                "share much less: view_volume has them.",
                "2, The calibrated cameras",
                {"litres_40": 85.40, "litres_90": 19.19},
            ),
            Mistake(
                "The volumes are in mm^3. A litre has 10^6 of them.",
                "2, The calibrated cameras",
                {"litres_40": 17.243e6, "litres_90": 7.582e6},
            ),
            Mistake(
                "You ask for markers that all three cameras see. One of the first two is enough as "
                "CCD3's partner.",
                "2, What the volume does not say",
                {"poses_40": 15.0, "poses_90": 1.0},
            ),
            Mistake(
                "At 10 deg CCD3 looks nearly as CCD1 and CCD2 do, and nothing bounds the depth: ask "
                "the result of view_volume for its status.",
                "2, Limits, and a broken case",
                {"at_10": "bounded"},
            ),
        ),
        {
            "litres_40": Asked(17.24, "l", within=0.1),
            "litres_90": Asked(7.58, "l", within=0.05),
            "poses_40": Asked(16.0, within=0.1),
            "poses_90": Asked(2.0, within=0.1),
            "at_10": Asked("unbounded", choices=("empty", "bounded", "unbounded")),
        },
    ),
)
