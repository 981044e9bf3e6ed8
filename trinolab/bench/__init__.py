"""The simulated bench: images of handle, hand and calibration target with their truth, and
recordings of them.

Nothing here knows how images are measured: the bench and the measurement share camera and handle
alone.
"""
