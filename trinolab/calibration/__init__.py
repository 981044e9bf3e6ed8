"""Calibration: images of a target to a rig (Sect. 6.2).

`calibrate` is the command's way from files to files; its steps are `target` (points of a target in
an image), `views` (which images belong together), `start` (a first camera in closed form), `eq25`
(Eq. 25), `adjust` (the joint adjustment, of what `model` says of the images), `outliers` (views that
do not fit the others), `mirrors` (cameras that mirror their images) and `distortions` (how many
coefficients the lens has).

The markers of a moving handle do as well as a target: `bundle` adjusts rig, marker layout and all
poses of a recording together, from what is known before (`prior`), without the views that do not fit
(`misfits`). Both eliminate the poses from the equations of a step, `normal`.
"""
