"""The likelihood against one dense Gaussian, and fits of motions that were drawn from known
models.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from trinolab import image_track, rigid
from trinolab.datasets import load_handle, load_real_sets, load_rig, real_set
from trinolab.files.fetch import why_not
from trinolab.following import posefilter
from trinolab.following.posefilter import FADING_S, PoseFilterParameters, transition
from trinolab.kalman import (
    KalmanParameters,
    constant_acceleration,
    initial_state,
    observation_matrix,
    white_jerk,
)
from trinolab.rigid import motion_between
from workbench.studies import tuning
from workbench.studies.tuning import (
    image_model,
    innovations,
    most_likely,
    nis_band,
    pose_models,
    pose_paths,
    tune_image,
    tune_pose,
)
from workbench.sweep.notebook import read_parameters

CHAPTER = Path(__file__).resolve().parents[3] / "notebooks" / "04_kalman.ipynb"
RIG, CODED = load_rig("raised_40deg"), load_handle("coded")
UNEVEN = np.cumsum([0.0, 0.03, 0.05, 0.02, 0.11, 0.03, 0.03, 0.07, 0.03, 0.03])
DRAWN = KalmanParameters(
    jerk_intensity=9e8, sigma_px=2.0, velocity_sigma=1200.0, acceleration_sigma=6000.0
)
MODEL = image_model(DRAWN)
P = PoseFilterParameters()
PAIR = RIG.part(range(2))
SETS = ("drawn", "handheld")


def drawn(p, times, count, rng):
    """Tracks drawn from the model itself, the first observation at the first time, shape
    (len(times), 2 * count).
    """
    steps, start, columns = np.diff(times), initial_state([0, 0], p), []
    F, Q = (
        [constant_acceleration(dt) for dt in steps],
        [white_jerk(dt, p.jerk_intensity) for dt in steps],
    )
    for _ in range(count):
        _, uv = image_track.draw(
            start, len(steps), F, Q, observation_matrix(), p.sigma_px**2 * np.eye(2), rng
        )
        columns.append(np.vstack([[0, 0], uv]))
    return np.hstack(columns)


def test_the_quick_filter_is_that_of_the_chapter():
    uv = np.random.default_rng(0).normal(0, 30, (len(UNEVEN), 2))
    way = image_track.track(UNEVEN, uv, DRAWN, gated=False)
    found = innovations(UNEVEN, uv, MODEL)
    np.testing.assert_allclose(found.squared.sum(axis=1), way.nis[1:], rtol=1e-9)
    np.testing.assert_allclose(found.variances, way.predicted.covariance[1:, 0, 0] + 4.0, rtol=1e-9)


@pytest.mark.parametrize("fading_s", [np.inf, 0.15])
def test_the_likelihood_is_that_of_one_gaussian_for_all_observations(fading_s):
    """The covariance of all observations at once, from the model's matrices, without a filter."""
    model, times = MODEL._replace(fading_s=fading_s), UNEVEN[:6]
    F = [transition(dt, fading_s) for dt in np.diff(times)]
    Q = [white_jerk(dt, model.jerk_intensity)[::2, ::2] for dt in np.diff(times)]
    C = np.zeros((len(times), len(times)))
    for i in range(1, len(times)):
        P = np.diag(np.square(model[1:4]))  # from the start on, with Q
        for k in range(i):
            P = F[k] @ P @ F[k].T + Q[k]
        for j in range(i, len(times)):
            C[i, j] = C[j, i] = P[0, 0] + (model.sigma**2 if i == j else 0.0)
            P = F[j] @ P if j + 1 < len(times) else P
    z = np.random.default_rng(1).normal(0, 20, (len(times), 3))
    expected = sum(
        multivariate_normal(np.full(len(z) - 1, one[0]), C[1:, 1:]).logpdf(one[1:]) for one in z.T
    )
    assert innovations(times, z, model).log_likelihood == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("fading_s", [0.02, 0.15, 3.0])
def test_the_fading_transition_is_that_of_the_differential_equation(fading_s):
    A = np.array([[0, 1, 0], [0, 0, 1], [0, 0, -1 / fading_s]])
    np.testing.assert_allclose(transition(0.07, fading_s), expm(A * 0.07), atol=1e-12)


def test_without_fading_it_is_that_of_the_paper():
    np.testing.assert_array_equal(transition(0.07), constant_acceleration(0.07)[::2, ::2])
    np.testing.assert_allclose(transition(0.07, 1e4), transition(0.07), atol=1e-5)  # dt / fading


def test_a_known_model_is_found_again():
    rng = np.random.default_rng(2)
    data = [(times, drawn(DRAWN, times, 60, rng)) for times in (np.arange(40) / 30, 3 * UNEVEN)]
    found = tune_image(
        data, KalmanParameters(jerk_intensity=1e7, sigma_px=10.0, velocity_sigma=100.0)
    )
    # over 20 draws a standard deviation of 4 %
    assert found.jerk_intensity == pytest.approx(9e8, rel=0.1)
    assert found.sigma_px == pytest.approx(2.0, rel=0.05)  # 2 %
    # of 240 starts, 5 %; the acceleration is hardly seen
    assert found.velocity_sigma == pytest.approx(1200, rel=0.2)
    squared = np.concatenate(
        [innovations(times, z, image_model(found)).squared.ravel() for times, z in data]
    )
    assert squared.mean() == pytest.approx(1.0, abs=1e-3)  # as the common scale is free


def test_only_what_is_free_is_fitted():
    z = drawn(DRAWN, UNEVEN, 10, np.random.default_rng(3))
    start = MODEL._replace(fading_s=0.5)
    found = most_likely([(UNEVEN, z)], start, ["jerk_intensity"])
    assert found[1:] == start[1:]
    likely = [
        innovations(
            UNEVEN, z, start._replace(jerk_intensity=found.jerk_intensity * f)
        ).log_likelihood
        for f in (0.9, 1.0, 1.1)
    ]
    assert likely[1] == max(likely)


def test_the_band_by_hand():
    low, high = nis_band(1)  # of two degrees: 1 - exp(-x / 2)
    assert (low, high) == pytest.approx((-2 * np.log(0.975), -2 * np.log(0.025)), abs=1e-12)
    low, high = nis_band(10_000)
    # nearly normal
    assert (low, high) == pytest.approx((2 - 1.96 * 0.02, 2 + 1.96 * 0.02), abs=5e-4)


@pytest.mark.heavy
def test_the_band_holds_95_percent_of_means_drawn_from_the_model():
    rng, times = np.random.default_rng(4), np.arange(30) / 30
    squared = innovations(times, drawn(DRAWN, times, 300, rng), MODEL).squared
    means = 2 * squared.reshape(29, 300, 2).mean(axis=(0, 2))
    low, high = nis_band(29)
    # 3 standard deviations of 300
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.95, abs=0.04)


# --- dropped instants


def true_clock(times, kept):
    return times[kept]


def even_clock(times, kept):
    return times[0] + np.arange(len(kept)) / 30


def nis_without_a_third(clock, rng, draws=60):
    """Mean NIS of three tracks drawn from the model, of 60 instants of which 40 are kept, and the
    band of that mean.
    """
    times, means = np.arange(60) / 30, []
    for _ in range(draws):
        z, kept = drawn(DRAWN, times, 3, rng), np.sort(rng.choice(60, 40, replace=False))
        squared = innovations(clock(times, kept), z[kept], MODEL).squared
        means.append(2 * squared.mean())
    return np.array(means), nis_band(squared.size // 2)


def test_dropped_instants_are_no_error_if_their_times_are_used():
    means, (low, high) = nis_without_a_third(true_clock, np.random.default_rng(5))
    # 3 standard deviations of 60
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.95, abs=0.09)


def test_dropped_instants_are_an_error_if_the_times_are_taken_for_even():
    means, (_, high) = nis_without_a_third(even_clock, np.random.default_rng(5), draws=20)
    assert means.min() > 5 * high


# --- the chapter's numbers


def chapter():
    values = read_parameters(CHAPTER)
    return KalmanParameters(
        **{
            name: values[name]
            for name in ("jerk_intensity", "sigma_px", "velocity_sigma", "acceleration_sigma")
        }
    )


@pytest.mark.heavy
@pytest.mark.parametrize("seeds", [range(1, 9), range(21, 29)], ids=["the chapter's", "others"])
def test_the_chapter_s_parameters_are_the_most_likely_ones(seeds):
    p, tracks = chapter(), tuning.drawn_tracks(RIG, CODED, seeds, np.random.default_rng(0))
    found = tune_image([tracks])
    # three sets of 8 seeds: 9.2 to 9.9e8
    assert found.jerk_intensity == pytest.approx(p.jerk_intensity, rel=0.15)
    assert found.sigma_px == pytest.approx(p.sigma_px, rel=0.1)
    assert found.velocity_sigma == pytest.approx(p.velocity_sigma, rel=0.2)
    squared = innovations(*tracks, image_model(p)).squared
    assert 2 * squared.mean() == pytest.approx(2.0, abs=0.3)


def test_found_centres_are_those_of_the_visible_markers():
    """At the limb the choice is the draw's; the columns that face the camera are always there."""
    _, poses = tuning.drawn_poses(3, 0.5)
    camera = RIG.cameras[0]
    centres = tuning.found_centres(camera, CODED, poses, np.random.default_rng(0))
    away = centres - camera.project(poses.translation)
    # px; half of the pattern is 12 mm, 60 px, and the centre lies near its middle
    assert np.abs(away).max() < 40
    jumps = np.abs(np.diff(away, axis=0)).max(axis=1)
    assert np.median(jumps) < 7  # half the step from a limb marker to its neighbour, 1.25 mm


@pytest.mark.heavy
def test_on_persons_motion_the_filter_is_right_in_the_mean_and_not_in_single_seconds():
    p, rng = chapter(), np.random.default_rng(10)
    means = tuning.seconds_nis(RIG, CODED, p, range(31, 35), rng)
    assert means.shape == (40, 3)
    assert means.mean() == pytest.approx(2.0, abs=0.6)
    low, high = nis_band(29)
    assert np.mean((means > low) & (means < high)) < 0.6  # of 95 % if a person's jerk were white
    # the cameras watch the same motion
    assert np.corrcoef(means.T)[0, 1] > 0.5


# --- the pose's filter


def test_the_pose_s_model_is_that_of_the_pose_filter():
    dt, p = 0.04, PoseFilterParameters()
    F, Q = posefilter.model(dt, p.jerk_mm, p.jerk_rad)
    np.testing.assert_allclose(transition(dt, FADING_S), F[::6, ::6], atol=1e-15)
    for model, axis in zip(pose_models(p), (0, 3), strict=True):
        one = white_jerk(dt, model.jerk_intensity)[::2, ::2]
        np.testing.assert_allclose(one, Q[axis::6, axis::6], rtol=1e-12)


def test_axes_one_by_one_say_what_the_pose_filter_says():
    """The filter of 18 numbers on poses, beside one of 3 numbers an axis on places and summed
    angles.
    """
    p, rng = PoseFilterParameters(), np.random.default_rng(6)
    times, poses = tuning.drawn_poses(1, 4.0)
    noisy = [
        rigid.shifted(
            T,
            np.concatenate(
                [p.floor_mm * rng.standard_normal(3), p.floor_rad * rng.standard_normal(3)]
            ),
        )
        for T in poses
    ]
    motion, squared = posefilter.begin(times[0], noisy[0], np.zeros((6, 6)), p), []
    for t, T in zip(times[1:], noisy[1:], strict=True):
        motion = posefilter.predict(motion, t, p)
        S = motion.pose_covariance + np.diag(np.repeat([p.floor_mm, p.floor_rad], 3) ** 2)
        squared.append(motion_between(T, motion.pose) ** 2 / np.diag(S))
        motion = posefilter.update(motion, T, np.zeros((6, 6)), p)
    whole = np.mean(squared, axis=0).reshape(2, 3)
    paths = pose_paths(poses, p, np.random.default_rng(7))
    axes = [
        innovations(times, path, model).squared.mean(axis=0)
        for path, model in zip(paths, pose_models(p), strict=True)
    ]
    # other draws of the noise: 119 squares have a scatter of 0.13
    np.testing.assert_allclose(axes, whole, atol=0.2)


@pytest.mark.heavy
def test_a_pose_s_model_is_fitted_to_persons_motion():
    data = [tuning.drawn_poses(seed, 5.0) for seed in range(1, 4)]
    position, rotation = tune_pose(data, np.random.default_rng(0))
    for kind, model, was in zip(
        (0, 1), (position, rotation), pose_models(PoseFilterParameters()), strict=True
    ):
        paths = [
            (times, pose_paths(poses, PoseFilterParameters(), np.random.default_rng(0))[kind])
            for times, poses in data
        ]
        likely = [
            sum(innovations(times, path, m).log_likelihood for times, path in paths)
            for m in (model, was)
        ]
        assert likely[0] >= likely[1]
    assert 1e7 < position.jerk_intensity < 1e8  # mm^2/s^5; eight seeds of 10 s: 3.8e7
    assert 1 < rotation.jerk_intensity < 20  # rad^2/s^5; 4


@pytest.mark.skipif(
    real_set("trajectories") is None,
    reason=f"no trajectories: {why_not(load_real_sets()['trajectories'])}",
)
def test_a_handheld_recording_is_of_the_same_kind():
    times, poses = tuning.handheld_poses()
    assert np.median(np.diff(times)) == pytest.approx(0.03, abs=0.001)
    px_a_mm = RIG.cameras[0].matrix[0, 0] / 570
    p, rng = chapter(), np.random.default_rng(8)
    uv = px_a_mm * poses.translation + p.sigma_px * rng.standard_normal((len(times), 3))
    kept = innovations(times, uv, image_model(p)).squared
    # not in the band of 1,500 (1.93 to 2.07): no hand's jerk is white
    assert 1 < 2 * kept.mean() < 3


@pytest.mark.parametrize(
    "call",
    [
        lambda: innovations([0.0], [[1.0]], MODEL),
        lambda: innovations([0, 0], [[1.0], [2.0]], MODEL),
        lambda: innovations([0, 1], [[1.0], [np.nan]], MODEL),
        lambda: innovations([0, 1], [[1.0]], MODEL),
        lambda: most_likely([(UNEVEN, UNEVEN[:, None])], MODEL, ["fading_s"]),
        lambda: most_likely([(UNEVEN, UNEVEN[:, None])], MODEL._replace(sigma=0.0), ["sigma"]),
        lambda: nis_band(0),
        lambda: nis_band(3, 0),
        lambda: nis_band(3, share=1.0),
        lambda: tuning.drawn_poses(1, 0.0),
        lambda: pose_paths(tuning.drawn_poses(1, 0.2)[1], PoseFilterParameters(), 3),
    ],
)
def test_bad_input_is_a_value_error(call):
    with pytest.raises(ValueError, match="expected"):
        call()


# --- motions of persons, and what is printed of them


def test_single_seconds_are_judged_one_by_one(monkeypatch):
    """One of them by a filter of its own; the tracks are nobody's motion."""
    times, z = np.arange(30) / 30, np.random.default_rng(1).normal(0, 30, (30, 2 * 2 * 10 * 2))
    monkeypatch.setattr(tuning, "drawn_tracks", lambda *_, **__: (times, z))
    means = tuning.seconds_nis(PAIR, CODED, DRAWN, [3, 4], np.random.default_rng(1))
    assert means.shape == (20, 2)
    seed, camera, second = 1, 0, 6
    start = 2 * (20 * seed + 10 * camera + second)  # of the track's two columns
    nis = image_track.track(times, z[:, start : start + 2], DRAWN, gated=False).nis
    assert means[10 * seed + second, camera] == pytest.approx(np.mean(nis[1:]), rel=1e-9)


def test_the_judgement_in_words_has_the_numbers_of_the_filter():
    data, models = [tuning.drawn_poses(seed, 0.5) for seed in (1, 2)], pose_models(P)
    lines = tuning.judge(data, models)
    rng = np.random.default_rng(1)
    paths = [(times, pose_paths(poses, P, rng)) for times, poses in data]
    assert [line.partition(":")[0] for line in lines] == ["position", "rotation"]
    for line, kind, model in zip(lines, (0, 1), models, strict=True):
        found = [innovations(times, both[kind], model) for times, both in paths]
        likely = sum(one.log_likelihood for one in found) / (2 * 14 * 3)
        whole = np.mean([one.squared.sum(axis=1) for one in found])
        assert f"log-likelihood {likely:6.3f}, NIS {whole:5.2f} of 3" in line
        assert f"jerk {model.jerk_intensity:9.3g}, fading {FADING_S:5.3g} s" in line


@pytest.fixture
def printed(monkeypatch, capsys):
    """Prints what is most likely, without fitting anything, with or without a recorded motion."""
    times, poses = tuning.drawn_poses(1, 0.3)

    def fitted(data, rng, free=("jerk_intensity", "fading_s")):
        return tuple(model._replace(jerk_intensity=float(len(free))) for model in pose_models(P))

    monkeypatch.setattr(tuning, "drawn_tracks", lambda *_: (times, np.zeros((len(times), 2))))
    monkeypatch.setattr(tuning, "tune_image", lambda data: DRAWN)
    monkeypatch.setattr(tuning, "tune_pose", fitted)
    monkeypatch.setattr(tuning, "drawn_poses", lambda seed, seconds: (times, poses))

    def of(handheld):
        monkeypatch.setattr(tuning, "handheld_poses", lambda: handheld and (times, poses))
        tuning.print_most_likely()
        return capsys.readouterr().out.splitlines()

    return of


def test_every_model_is_judged_on_every_motion(printed):
    lines = printed(True)
    fits = [f"fitted to {name}{kept}" for name in SETS for kept in ("", ", fading kept")]
    assert lines[0] == f"image: {DRAWN}"
    assert [line for line in lines if line.startswith("pose")] == [
        f"pose, {name} motion, {which}:" for name in SETS for which in ("as it is", *fits)
    ]
    assert sum("position: jerk         1," in line for line in lines) == 4  # the fading is kept
    assert sum("position: jerk         2," in line for line in lines) == 4


def test_a_recording_that_is_not_here_is_said_to_be_missing(printed):
    lines = printed(None)
    assert lines[-1].startswith("handheld motion: not here, ")
    assert not any("motion, fitted to handheld" in line for line in lines)
