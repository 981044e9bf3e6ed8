"""Values of exercises that are read from the standard recordings, by another way than the chapter's."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import RigidTransform
from solutions import says

from trinolab import background, matching, metrics
from trinolab.following import posetracker
from trinolab.kalman import KalmanParameters
from trinolab.markers import find_markers
from trinolab.parameters import Parameters
from workbench import intervals
from workbench.course.exercises import exercise
from workbench.studies import ground_truth, markertrack, match_rivals, tuning

T, SHADOW = 15.0, 0.3


def agrees(number, name, value):
    asked = exercise(number).asked[name]
    assert abs(value - asked.value) <= asked.within


def moved(frame, lit):
    """What the cured rule of chapter 3 calls moving."""
    shown = np.minimum(lit, 255)
    return (frame - shown > T) | (shown - frame > SHADOW * shown + T)


def watched(frames, empty, truths, light):
    """Shares of false and of missed pixels, mean of frames 30 to 59, and false in the last, percent."""
    B = empty.astype(float)
    false, missed = [], []
    for frame, truth in zip(frames, truths, strict=True):
        lit = light(frame, B) * B
        moving = moved(frame, lit)
        B = np.where(moving | (frame >= 255), lit, 0.01 * frame + 0.99 * lit)
        false.append(moving[truth.outside].mean())
        missed.append(1 - moving[truth.inside].mean() if truth.inside.any() else np.nan)
    return 100 * np.mean(false[30:]), 100 * np.nanmean(missed[30:]), 100 * false[-1]


def in_tiles(*images):
    """Parts of the images in 8 x 8 tiles, row by row."""
    rows = zip(*(np.vsplit(image, 8) for image in images), strict=True)
    return [list(zip(*(np.hsplit(row, 8) for row in parts), strict=True)) for parts in rows]


def blown_up(factors, shape):
    return np.kron(factors, np.ones((shape[0] // 8, shape[1] // 8)))


def ratios(frame, B):
    tells = (B > 10) & (frame > 0) & (frame < 255)
    return frame[tells] / B[tells]


def mended(share):
    """Factors of tiles; a tile that agrees with its own too little takes that of its neighbours."""

    def light(frame, B):
        parts = in_tiles(frame, B)
        factors = np.array([[background.light_gain(*part, 1) for part in row] for row in parts])
        agreeing = np.zeros((8, 8), bool)
        for place in np.ndindex(8, 8):
            off = np.log(ratios(*parts[place[0]][place[1]]) / factors[place])
            agreeing[place] = off.size > 0 and (np.abs(off) < 0.15).mean() >= share
        mean = factors.copy()
        for place in np.argwhere(~agreeing):
            half = np.s_[:, :4] if place[1] < 4 else np.s_[:, 4:]
            good = np.zeros((8, 8), bool)
            good[half] = agreeing[half]
            if good.any():
                squared = ((np.argwhere(good) - place) ** 2).sum(axis=1)
                mean[tuple(place)] = factors[good][squared == squared.min()].mean()
        return blown_up(mean, frame.shape)

    return light


@pytest.mark.heavy
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
        parts = in_tiles(frame, B)
        factors = [[background.light_gain(*part, 1) for part in row] for row in parts]
        return blown_up(factors, frame.shape)

    def medians(frame, B):
        parts = in_tiles(frame, B)
        return blown_up([[np.median(ratios(*part)) for part in row] for row in parts], frame.shape)

    right, left = (shone_on(part) for part in (slice(width // 2, None), slice(0, width // 2)))
    on_right = watched(right, empty, truths, one_factor)
    on_left = watched(left, empty, truths, one_factor)
    by_tiles = watched(right, empty, truths, tiles)
    agrees("03.6", "false_right", on_right[0])
    agrees("03.6", "false_left", on_left[0])
    agrees("03.6", "tiles_missed", by_tiles[1])

    says("03.6", f"{on_right[0]:.1f} % of the bench are false on average over frames 30 to 59")
    says("03.6", f"and {on_right[2]:.0f} % in the last")
    says(
        "03.6",
        f"only {on_left[0]:.2f} % are false, but {on_left[1]:.1f} % of the moving pixels are",
    )
    says("03.6", f"Tiles cure the lamp: {by_tiles[0]:.1f} % are false.")
    by_medians = watched(right, empty, truths, medians)
    says("03.6", f"{by_tiles[1]:.0f} % of the moving pixels are missed ({by_medians[1]:.0f} % with")
    much, little = (watched(right, empty, truths, mended(share)) for share in (0.85, 0.7))
    says("03.6", f"then {much[1]:.2f} % are missed and {much[0]:.1f} % are false.")
    says("03.6", f"At 70 % it is still {little[1]:.0f} % missed")


@pytest.mark.heavy
def test_the_whole_recording_of_chapter_4():
    """Exercise 4.5; the recording is rendered first, which takes some minutes."""
    recording = ground_truth.read_recording("calm", range(20, 300), seconds=10.0)
    p = Parameters(kalman=KalmanParameters(9.5e8, 1.5, 1200.0, 6000.0))  # the chapter's
    medians, seconds, inside = [], [], 0
    for index, name in enumerate(recording.rig.names):
        images = recording.images_of(index)
        regions = markertrack.moving_regions(images, recording.empty[index])
        looks = markertrack.follow(images, recording.times_s, recording.handle, regions, p)[11:]
        of_looks = np.array([look.nis for look in looks])
        nis = of_looks[np.isfinite(of_looks)]
        low, high = tuning.nis_band(len(nis))
        inside += low < nis.mean() < high
        at_least, at_most, _ = intervals.of_mean(nis)
        refused = sum(np.isfinite(look.nis) and not look.used for look in looks)
        says(
            "04.5",
            f"| {name.upper()} | {nis.mean():.2f} | {len(nis)} | {low:.2f} to {high:.2f} "
            f"| {at_least:.2f} to {at_most:.2f} | {refused} |",
        )
        agrees("04.5", name, nis.mean())
        medians.append(np.median(nis))
        whole = len(of_looks) // 30 * 30
        seconds.extend(np.nanmean(of_looks[:whole].reshape(-1, 30), axis=1))
    agrees("04.5", "inside", inside)
    says("04.5", f"single seconds, which run from {min(seconds):.1f} to {max(seconds):.1f}.")
    says("04.5", f"The medians are {min(medians):.1f} to {max(medians):.2f},")


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
        shot = match_rivals.shot_of(now, rig, uv, handle)
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
        off = [np.linalg.norm(T.translation - truth.translation) for T, truth in kept]
        mistakes = [one.gives.get("mm_4") for one in exercise("01.5").mistakes]
        assert any(one == pytest.approx(max(off), abs=0.0005) for one in mistakes if one)
