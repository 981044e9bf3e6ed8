"""Calibration: images of a target to a rig (Sect. 6.2).

`calibrate` leads from image files to a rig file. Its steps are `target` (a target's points in an
image), `views` (the images that belong together), `start` (a first camera in closed form), `eq25` (Eq.
25), `adjust` (the joint adjustment of the image model in `model`), `outliers` (views that do not fit
the others), `mirrors` (cameras that mirror their images) and `distortions` (the number of the lens's
coefficients).

The markers of a moving handle can replace the target: `bundle` adjusts rig, marker layout and all poses
of a recording together, from a prior (`prior`) and without the views that do not fit (`misfits`). Both
adjustments eliminate the poses from the normal equations (`normal`).
"""
