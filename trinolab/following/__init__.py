"""The handle followed through a recording by its pose (beyond the paper, which follows points in
images).

`track` is the command's way from files to files; its steps are `posetracker` (one instant),
`posefilter` (the prediction) and `look` (the handle where it is expected). `sync` finds how far the
clocks of the cameras lie apart, and `clocks` says what that does to the poses. `refine` is the way of
another command, from a recording to a better rig and handle, by the `centres` of markers in some
instants.
"""
