"""trinolab: a master handle watched by three cameras, from the frames to the slave arm.

Lengths are millimetres, times seconds, angles radians; names that end in ``_deg`` are degrees.
Rigid motions are named ``T_target_source``, so that neighbours cancel: ``T_world_handle = T_world_cam * T_cam_handle``.

A mistake of the caller's is a ``ValueError`` in one line that names the argument, what was expected and what came: a
wrong shape or type, lengths that differ, NaN where nothing may be missing, a number out of the range that is documented
or beyond any bench (`checks.LARGEST`). A docstring says what is raised beside that.
"""

__version__ = "0.1.0"
