"""A6: availability: the share of the instants that is measured while a person moves and things get
in the way, and the time until the handle is found again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.bench.rendering import scripted
from trinolab.bench.scenario import Job, seen_markers
from trinolab.camera import Rig
from trinolab.checks import Array
from trinolab.metrics import FAR_DEG, FAR_MM, can_be_measured, waits
from workbench.intervals import TOGETHER

from . import tracks
from .numbers import LARGEST, OWN, Answer, Number, distribution, far_count, share
from .setup import CENTRE_MM, Setup
from .tracks import FPS, Row, Track

NAME = "A6"
TITLE = "Availability"
SECONDS = 10.0  # of the script: all that it has
SHARE = 1 / 512  # of the script for a smaller sheet, from its start
FEWEST_S = 1.0


def parts(setup: Setup) -> int:
    """One sequence: the tracker goes through it from end to end."""
    return 1


def run(setup: Setup, k: int) -> list[Row]:
    """Render and follow the script."""
    return tracks.follow(tracks.taken(job_of(setup)), setup)


def job_of(setup: Setup) -> Job:
    """The standard script ``hard`` before the cameras: a person's hand and forearm hold the handle,
    a second hand hides it from each camera in turn, the light steps and drifts, a camera is
    covered, the handle leaves the images and is away.
    """
    seconds = min(max(FEWEST_S, SECONDS * SHARE * setup.poses), SECONDS)
    return scripted("hard", before(setup), setup.handle, setup.seed, seconds, FPS)


def before(setup: Setup) -> Rig:
    """The rig with the middle of the standard scene in its field of view.

    As it is, if the middle of the scene is in its field; otherwise its first camera looks along the
    scene's z, and the middle of the field is that of the scene.
    """
    if setup.field.holds(CENTRE_MM[None])[0]:
        return setup.rig
    first = setup.rig.cameras[0].T_cam_world
    middle = first.apply(setup.field.centre)
    T = RigidTransform.from_translation(CENTRE_MM - middle) * first  # T_scene_world
    cameras = (replace(c, T_cam_world=c.T_cam_world * T.inv()) for c in setup.rig.cameras)
    return replace(setup.rig, cameras=tuple(cameras))


def judge(setup: Setup, rows: list[list[Row]]) -> Answer:
    """The share that is measured of all instants, and of those at which it is possible; losses; and
    the error meanwhile.
    """
    job = job_of(setup)
    track = tracks.as_track(rows[0])
    visible = can_be_measured([seen_markers(job, k) for k in range(len(job.shots))])
    answer = _availability(track, visible, setup.seed, OWN)
    present = np.array([shot.T_world_handle is not None for shot in job.shots])
    measured = track.found & present
    if measured.any():
        truths = [shot.T_world_handle for shot in job.shots if shot.T_world_handle is not None]
        off = tracks.errors(track.only(present), RigidTransform.concatenate(truths), setup)[0]
        distances, angles = tracks.lengths(off[measured[present]])
        # an instant without a handle has no true pose: whatever is measured there is wrong
        far = ((distances > FAR_MM) | (angles > FAR_DEG)).sum() + (track.found & ~present).sum()
        answer.numbers += [
            *distribution(
                NAME, "position error meanwhile", distances, "mm", setup.seed, together=TOGETHER
            ),
            far_count(NAME, int(far), int(track.found.sum()), setup.seed),
        ]
    answer.notes.append(
        f"The script `hard`, {len(job.shots) / FPS:.3g} s at {FPS:g} instants per second: a person's "
        "motion, hand and forearm, a second hand that hides the handle from one camera after the "
        "other, a step of the light by 1.5, a covered camera, a handle that leaves the images. "
        "Possible is an instant at which one camera truly sees four markers, or two see three "
        "each. What happens lasts: half a second of instants counts as one in the intervals."
    )
    return answer


def judge_recording(track: Track, source: str) -> Answer:
    """The share of a recording that is measured, and its losses."""
    answer = _availability(track, None, None, source)
    answer.notes.append(
        f"{source}: whether a loss could have been avoided is not known without the truth."
    )
    return answer


def _availability(
    track: Track, visible: np.ndarray | None, seed: int | None, source: str
) -> Answer:
    measured = track.found
    n = len(measured)
    count = int(measured.sum())
    numbers = [share(NAME, "measured, of all instants", count, n, seed, source, together=TOGETHER)]
    if visible is not None and visible.any():
        count, of = int((measured & visible).sum()), int(visible.sum())
        what = "measured, of the possible instants"
        numbers.append(share(NAME, what, count, of, seed, source, together=TOGETHER))
    step = float(np.median(np.diff(track.t_s))) if n > 1 else np.nan
    ended, unended = waits(measured, visible)
    lasted = step * np.array(ended, float)
    numbers.append(
        Number(
            NAME,
            "losses",
            "count",
            float(len(lasted) + (unended is not None)),
            "",
            n,
            seed,
            source,
            note="" if unended is None else f"the last one, of {unended * step:.2g} s, did not end",
        )
    )
    numbers += _times(lasted, seed, source)
    return Answer(numbers)


def _times(lasted: Array, seed: int | None, source: str) -> list[Number]:
    """How long the losses lasted that ended, each counted in instants at which it was possible."""
    if len(lasted) == 0:
        return []
    note = ", ".join(f"{one:.2g}" for one in lasted[:8]) + (" ..." if len(lasted) > 8 else "")
    return [
        Number(
            NAME,
            "time until it is found again",
            statistic,
            float(value),
            "s",
            len(lasted),
            seed,
            source,
            note=note if statistic == LARGEST else "",
        )
        for statistic, value in (("median", np.median(lasted)), (LARGEST, lasted.max()))
    ]
