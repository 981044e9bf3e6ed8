"""The factor of the light, against the one that a frame was made with."""

import numpy as np
import pytest

from trinolab.light import light_gain


@pytest.mark.parametrize("gain", [0.6, 1.0, 1.35])
def test_light_gain_under_noise_and_a_hand(gain):
    rng = np.random.default_rng(1)
    background = 45 + 7 * rng.standard_normal((300, 400))
    frame = gain * background
    frame[100:250, 50:250] = 130.0  # a quarter of the image
    frame = np.clip(np.rint(frame + 2.1 * rng.standard_normal(frame.shape)), 0, 255).astype(np.uint8)
    # The median slides up by what a quarter of outliers makes of a ratio's scatter of 2.1 / 45.
    assert light_gain(frame, background) == pytest.approx(gain, abs=0.025)


def test_light_gain_of_a_covered_lens_or_a_dark_background_is_one():
    assert light_gain(np.zeros((8, 8), np.uint8), np.full((8, 8), 50.0)) == 1.0
    assert light_gain(np.full((8, 8), 50, np.uint8), np.zeros((8, 8))) == 1.0


@pytest.mark.parametrize("call", [
    lambda: light_gain(np.ones((8, 8)), np.ones((8, 8)), 0), lambda: light_gain(np.ones((8, 8)), np.ones((7, 8))),
    lambda: light_gain(np.ones(8), np.ones(8))])
def test_bad_input_is_a_value_error(call):
    with pytest.raises(ValueError, match="expected"):
        call()
