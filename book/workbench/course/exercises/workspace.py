"""Exercises of chapter 2: the workspace."""

from __future__ import annotations

import numpy as np

from ..exercise import FunctionExerciseMaker


def _turned(degrees, about, shift):
    """A rigid motion (4, 4): a turn about an axis of the frame, and a shift."""
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler(about, degrees, degrees=True).as_matrix()
    T[:3, 3] = shift
    return T


def _pyramid(p, T, matrix, size, low=-0.5, high=0.5, order=(0, 1), behind=False):
    x, y, z = T[:3, :3] @ p + T[:3, 3]
    if z <= 0 and not behind:
        return False
    u, v, w = matrix @ [x, y, z]
    ends = np.array([size[order[0]], size[order[1]]]) - high
    return bool(low <= u / w <= ends[0] and low <= v / w <= ends[1])


in_pyramid_exercise = FunctionExerciseMaker("02.3", "A pyramid", "ex-workspace-pyramid", points=4)


@in_pyramid_exercise.solution
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


@in_pyramid_exercise.cases
def _pyramid_cases(rng):
    """Points beside each edge of the image, behind the camera, and well inside, of three cameras."""
    matrix = np.array([[2900.0, 0.0, 640.0], [0.0, 2950.0, 500.0], [0.0, 0.0, 1.0]])
    size = (1280, 1024)
    # a tenth of a pixel inside of each edge, and outside
    inside = [(640.0, 500.0, 550.0), (-0.4, 300.0, 500.0), (1279.4, 900.0, 600.0)]
    outside = [(-0.6, 300.0, 500.0), (1279.6, 400.0, 550.0), (1100.0, 1023.6, 600.0)]
    above = [(640.0, -0.4, 560.0), (500.0, -0.6, 540.0), (800.0, -150.0, 500.0)]
    high = [(300.0, 60.0, 580.0), (900.0, 8.0, 510.0), (640.0, 1500.0, 530.0)]
    near = [(640.0, 1023.4, 550.0), (600.0, 450.0, 0.5), (600.0, 450.0, -0.5)]
    places = [
        *inside,
        *outside,
        *above,
        *high,
        *near,
        (700.0, 400.0, -550.0),
        (1150.0, 1010.0, 520.0),
    ]
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


@in_pyramid_exercise.mistake("2, One cone, one point")
def _behind_as_well(p, T_cam_world, matrix, size):
    """Points behind the camera are let through. They project into the image as well: look at the
    sign of z first.
    """
    return _pyramid(p, T_cam_world, matrix, size, behind=True)


@in_pyramid_exercise.mistake("2, The calibrated cameras")
def _other_way(p, T_cam_world, matrix, size):
    """The motion is used the other way round: T_cam_world takes the world's coordinates to the
    camera's, and its inverse does not.
    """
    return _pyramid(p, np.linalg.inv(T_cam_world), matrix, size)


@in_pyramid_exercise.mistake("2, Derivation")
def _transposed(p, T_cam_world, matrix, size):
    """The rotation is transposed."""
    T = np.array(T_cam_world)
    T[:3, :3] = T[:3, :3].T
    return _pyramid(p, T, matrix, size)


@in_pyramid_exercise.mistake("2, The calibrated cameras")
def _size_swapped(p, T_cam_world, matrix, size):
    """Width and height are swapped: u runs along the width, v along the height."""
    return _pyramid(p, T_cam_world, matrix, size, order=(1, 0))


@in_pyramid_exercise.mistake("2, Exercises")
def _from_zero(p, T_cam_world, matrix, size):
    """Half a pixel: (0, 0) is the centre of the top-left pixel. So the image begins at -0.5 and
    ends at width - 0.5.
    """
    return _pyramid(p, T_cam_world, matrix, size, low=0.0, high=0.0)


@in_pyramid_exercise.mistake("2, Exercises")
def _centres(p, T_cam_world, matrix, size):
    """This lets in what lies between the centres of the outermost pixels. The image ends at their
    outer edges, half a pixel further out.
    """
    return _pyramid(p, T_cam_world, matrix, size, low=0.0, high=1.0)


EXERCISES = (in_pyramid_exercise.made(),)
