"""The handle followed through a recording by its pose (beyond the paper, which follows points in
images).

`track` is the command, from files to files; its steps are `posetracker` (one instant), `posefilter`
(the prediction) and `look` (the handle where it is expected). `sync` estimates the offsets between
the cameras' clocks, and `clocks` their effect on the poses. `refine` is another command, from a
recording to a better rig and handle, by the `centres` of markers in some instants.
"""
