"""Poses, rigs and recordings of small scenes, and what cameras see in them."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig
from trinolab.estimators.appearance import Views
from trinolab.estimators.centroids import predict_centroids
from trinolab.files import recording_writer
from trinolab.files.poses import truth_table
from trinolab.handle import slants


def pose(place_mm, zyx_deg=(0.0, 0.0, 0.0)):
    turn = Rotation.from_euler("ZYX", zyx_deg, degrees=True)
    return RigidTransform.from_components(place_mm, turn)


def moved(T, step):
    """A pose after a small motion in the handle's frame."""
    return T * RigidTransform.from_components(step[:3], Rotation.from_rotvec(step[3:]))


def bent(rig, *lens):
    """The rig with lenses of some distortions."""
    cameras = (replace(camera, distortions=np.array(lens)) for camera in rig.cameras)
    return Rig(tuple(cameras))


def close_up(rig, place, side=400):
    """The rig with square images about a place, mm: small, at the full resolution."""
    cameras = []
    for camera in rig.cameras:
        matrix = camera.matrix.copy()
        matrix[:2, 2] -= np.round(camera.project(np.array(place)[None])[0]) - side / 2
        cameras.append(replace(camera, size=(side, side), matrix=matrix))
    return Rig(tuple(cameras))


def facing(rig, handle, T, steepest_deg):
    """The views of the markers that face a camera within an angle, and their slants, rad."""
    slant = np.stack([slants(handle, T, camera.centre) for camera in rig.cameras])
    views = Views(*np.nonzero(slant < np.deg2rad(steepest_deg)))
    return views, slant[views]


def centroids(rig, handle, T, steepest_deg):
    """Predicted pixels (cameras, markers, 2) of those; NaN for the others."""
    views, _ = facing(rig, handle, T, steepest_deg)
    uv = np.full((len(rig.cameras), len(handle.marker_centres), 2), np.nan)
    uv[views] = predict_centroids(rig, handle, T, views)[0]
    return uv


def record(folder, rig, handle, poses, fps, true=None):
    """A recording of a handle in these poses; what is rendered may be another rig and handle."""
    rng = np.random.default_rng(0)
    partial = recording_writer.begin(folder, rig, handle)
    for k, T in enumerate(poses):
        images = render_rig(*(true or (rig, handle)), T, Bench(), rng)
        recording_writer.add(partial, rig, k, images)
    recording_writer.finish(folder, np.arange(len(poses)) / fps, truth_table(poses))
    return folder
