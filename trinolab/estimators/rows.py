"""The rows of the arrays that `loops` fills for a window: one row per quantity, one column per cell."""

# rows of a window's layers, before the blur
MARKER_SHARE = 0  # of the cell's area that the view's marker covers
BODY_SHARE = 1  # that all of the body covers
SINE = 2  # of the angle about the axis from the marker's column
VERSINE = 3  # 1 - cosine of it
CLEARANCE = 4  # distance from another marker's edge or the body's end, in cells
MARKER_MOTION = 5  # six rows: derivative of the marker's share by a motion of the handle
BODY_MOTION = 11  # six rows: of the body's share
LAYERS = 17

# rows of a window's linear model, after the blur
POSE = 0  # six rows: derivative of the grey level by a motion of the handle
EXPOSURE = 6  # six rows: by the motion while the shutter is open
BLUR = 12  # by the variance of the lens's blur
GREYS = 13  # six or nine rows: by the window's greys
GLOSS = 22  # three rows: by the gloss, whether it is among the greys or not
PREDICTED = 25
RESIDUAL = 26
WEIGHT = 27
MARKER = 28  # shares after the blur
BODY = 29
MODEL = 30
