"""Values of exercises that are read from the standard recordings, by another way than the chapter's."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import RigidTransform

from trinolab import background, matching, metrics
from trinolab.following import posetracker
from trinolab.markers import find_markers
from workbench.course.exercises import exercise
from workbench.studies import ground_truth, match_rivals

T, SHADOW = 15.0, 0.3


def agrees(number, name, value):
    asked = exercise(number).asked[name]
    assert abs(value - asked.value) <= asked.within


def moved(frame, lit):
    """What the cured rule of chapter 3 calls moving."""
    shown = np.minimum(lit, 255)
    return (frame - shown > T) | (shown - frame > SHADOW * shown + T)


def watched(frames, empty, truths, light):
    """Shares of false and of missed pixels, mean of frames 30 to 59, percent."""
    B = empty.astype(float)
    false, missed = [], []
    for frame, truth in zip(frames, truths, strict=True):
        lit = light(frame, B) * B
        moving = moved(frame, lit)
        B = np.where(moving | (frame >= 255), lit, 0.01 * frame + 0.99 * lit)
        false.append(moving[truth.outside].mean())
        missed.append(1 - moving[truth.inside].mean() if truth.inside.any() else np.nan)
    return 100 * np.mean(false[30:]), 100 * np.nanmean(missed[30:])


def test_the_second_lamp_of_chapter_3():
    hard = ground_truth.read_recording("hard", every=4)
    truths = ground_truth.moving(hard, 2, 2)
    empty = hard.empty[2]
    width = empty.shape[1]

    def shone_on(part):
        frames = []
        for k, frame in enumerate(hard.images_of(2)):
            lit = frame.astype(float)
            if k >= 30:
                lit[:, part] *= 1.3
            frames.append(np.clip(np.rint(lit), 0, 255).astype(np.uint8))
        return frames

    def one_factor(frame, B):
        return background.light_gain(frame, B, 4)

    def tiles(frame, B):
        factors = [
            [background.light_gain(*parts, 1) for parts in zip(*rows, strict=True)]
            for rows in (
                [np.hsplit(row, 8) for row in pair]
                for pair in zip(np.vsplit(frame, 8), np.vsplit(B, 8), strict=True)
            )
        ]
        return np.kron(factors, np.ones((frame.shape[0] // 8, frame.shape[1] // 8)))

    right, left = (shone_on(part) for part in (slice(width // 2, None), slice(0, width // 2)))
    agrees("03.6", "false_right", watched(right, empty, truths, one_factor)[0])
    agrees("03.6", "false_left", watched(left, empty, truths, one_factor)[0])
    agrees("03.6", "tiles_missed", watched(right, empty, truths, tiles)[1])


def test_the_pairs_of_chapter_6():
    """The set with the largest sum of S, and the constraints without the correlation."""
    drawn = np.sort(np.random.default_rng(0).choice(90, 24, replace=False))
    clips = (
        ground_truth.read_recording("calm", 30 + drawn[drawn < 30]),
        ground_truth.read_recording("hard", drawn[drawn >= 30] - 30),
    )
    rig, handle = clips[0].rig, clips[0].handle
    best_set, blind = np.zeros(2, int), np.zeros(2, int)
    for now in [*clips[0].instants, *clips[1].instants]:
        uv = tuple(
            find_markers(image, len(handle.marker_centres), handle.markers).uv
            for image in now.images
        )
        shot = match_rivals.shot_of(now, rig, uv)
        for i, j in rig.pairs:
            left, right = rig.cameras[i], rig.cameras[j]
            D = matching.epipolar_distances(left, right, uv[i], uv[j])
            S = matching.ncc_matrix(now.images[i], now.images[j], uv[i], uv[j], 21)
            value = np.where((D < 2) & (S > 0.5), S, 0)
            pairs = np.column_stack(linear_sum_assignment(value, maximize=True))
            pairs = pairs[value[tuple(pairs.T)] > 0]
            found = match_rivals.counts(shot, i, j, pairs)
            best_set += (found["wrong"], found["missing"])
            settings = matching.MatchParameters(2.0, -1.0)
            views = (left, right, now.images[i], now.images[j], uv[i], uv[j])
            found = match_rivals.counts(shot, i, j, matching.match(*views, settings).index)
            blind += (found["wrong"], found["missing"])
    for number, counts in (("06.7", best_set), ("06.6", blind)):
        for name, count in zip(("wrong", "missing"), counts, strict=True):
            agrees(number, name, count)


@pytest.mark.heavy
@pytest.mark.parametrize("step", [1, 2, 4, 6])
def test_the_film_with_fewer_frames_of_chapter_1(step):
    clip = ground_truth.read_recording("hard", range(0, 60, step))
    followed = posetracker.track_instants(clip.instants, clip.rig, clip.handle)
    kept = [
        (seen.measurement.pose.T_world_handle, now.T_world_handle)
        for now, seen in followed
        if seen.measurement.pose.status == "measured"
    ]
    agrees("01.5", f"measured_{step}", len(kept))
    if step == 4:
        errors = metrics.pose_errors(*map(RigidTransform.concatenate, zip(*kept, strict=True)))
        agrees("01.5", "mm_4", errors.E_t_mm)
