"""The factor of the light, against the one that a frame was made with."""

import numpy as np
import pytest

from trinolab.background import light_gain


@pytest.mark.parametrize("gain", [0.6, 1.0, 1.35])
def test_light_gain_under_noise_and_a_hand(gain):
    rng = np.random.default_rng(1)
    background = 45 + 7 * rng.standard_normal((300, 400))
    frame = gain * background
    frame[:, :240] = gain * rng.uniform(60, 130, (300, 240))  # six tenths of the image
    frame = np.clip(np.rint(frame + 2.1 * rng.standard_normal(frame.shape)), 0, 255).astype(
        np.uint8
    )
    # A ratio scatters by 0.05 about the gain; what has moved has ratios of 1.3 to 3, and hardly
    # pulls the middle of it.
    assert light_gain(frame, background) == pytest.approx(gain, abs=0.005)


def test_light_gain_of_a_covered_lens_or_a_dark_background_is_one():
    assert light_gain(np.zeros((8, 8), np.uint8), np.full((8, 8), 50.0)) == 1.0
    assert light_gain(np.full((8, 8), 50, np.uint8), np.zeros((8, 8))) == 1.0


def test_light_gain_by_what_is_not_saturated():
    background = np.hstack([np.full((60, 80), 200.0), np.full((60, 40), 45.0)])
    # two thirds of it are 255, a ratio of 1.28
    frame = np.clip(np.rint(1.6 * background), 0, 255).astype(np.uint8)
    assert light_gain(frame, background) == pytest.approx(1.6)


def test_light_gain_needs_agreement():
    rng = np.random.default_rng(2)
    # a covered lens, a few hot pixels
    frame = np.where(rng.uniform(size=(80, 100)) < 0.05, 90, 0).astype(np.uint8)
    assert light_gain(frame, np.full(frame.shape, 45.0), 1) == 1.0


@pytest.mark.parametrize(
    "call",
    [
        lambda: light_gain(np.ones((8, 8)), np.ones((8, 8)), 0),
        lambda: light_gain(np.ones((8, 8)), np.ones((7, 8))),
        lambda: light_gain(np.ones(8), np.ones(8)),
    ],
)
def test_bad_input_is_a_value_error(call):
    with pytest.raises(ValueError, match="expected"):
        call()
