"""trinolab: a master handle watched by three cameras, from the frames to the slave arm.

Lengths are millimetres, times seconds, angles radians; names that end in ``_deg`` are degrees.
Rigid motions are named ``T_target_source``, so that neighbours cancel: ``T_world_handle = T_world_cam * T_cam_handle``.
"""

__version__ = "0.1.0"
