"""The live loop: the latest frames through tracker, mapping and arm, in one thread.

Nothing waits in it but the samples of the added delay, which are as many as fit into that time.
What cannot be trusted, no frame, a camera in trouble, a page that does not answer, makes the arm
hold at once.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from threading import Event, Lock, Thread
from typing import NamedTuple

import numpy as np

from trinolab import tracker
from trinolab.checks import Array
from trinolab.following import posetracker
from trinolab.following.parameters import FollowParameters
from trinolab.following.posetracker import Tracked
from trinolab.rigid import apart, motion_between, shifted
from trinolab.slave.mapping import MappingParameters, Sample
from workbench.capture.devices import Taken
from workbench.teleop.session import TOUCHED_N, Moment, Now, Session, changes

from . import settings
from .demonstration import NAME, Demonstration, Seen
from .pointing import Doing, Pointing
from .recorder import Recorder
from .settings import PAPER, POSE, Values
from .solids import arm_points, body_poses
from .sources import Latest, Source

WAIT_S = 0.1  # for a new frame; then the page is told all the same
NO_FRAME_S = 0.3  # without one the arm holds; the mapping takes a pose that is older for stale
SILENCE_S = 1.0  # of the page, after which its clutch is open
NOTES = 6  # of what happened, shown on the page


class Stages(NamedTuple):
    """Where the time went, ms: waiting for the loop, tracker, mapping and arm."""

    wait: float
    track: float
    arm: float


class Shown(NamedTuple):
    """What there is to show of a round.

    Attributes
    ----------
    number : int
        Of the round.
    frames : Latest or None
        None before the first one.
    new : bool
        Whether they are of this round.
    tracked : Tracked or None
    moment : Moment
    arm : list of list of float
        Points of the arm from its base to its tool, mm, base frame.
    bodies : list of float
        Poses of the arm's bodies, see `solids.body_poses`.
    clutch : bool
    troubles, notes : list of str
    recording : (bool, str)
        Whether one grows, and what is to be said of it.
    finished : Path or None
        The last recording that was written to its end.
    rate_hz : float
        Frames a second.
    stages : Stages
    tracker : str
        `settings.POSE` or `settings.PAPER`.
    values : dict
        Of the sliders.
    task : Doing or None
        What the pointing task asks for; None if none goes on.
    task_status : str
        How it went, in words.
    demonstration : bool
        Whether the simulated hand plays the task by itself.
    """

    number: int
    frames: Latest | None
    new: bool
    tracked: Tracked | None
    moment: Moment
    arm: list[list[float]]
    bodies: list[float]
    clutch: bool
    troubles: list[str]
    notes: list[str]
    recording: tuple[bool, str]
    finished: Path | None
    rate_hz: float
    stages: Stages
    tracker: str
    values: Values
    task: Doing | None
    task_status: str
    demonstration: bool


class Loop:
    """The loop, which runs from `start` to `close`. What a page may do, it does by these methods.

    Parameters
    ----------
    source : Source
    session : Session
    recorder : Recorder
    pointing : Pointing
    estimator : str
        Of the tracker that follows the pose.
    silence_s : float
        So long may the page be silent while the clutch is closed.
    """

    def __init__(
        self,
        source: Source,
        session: Session,
        recorder: Recorder,
        pointing: Pointing,
        estimator: str = "patches",
        silence_s: float = SILENCE_S,
    ) -> None:
        self.source = source
        self.newest: Shown | None = None
        self.failed: Exception | None = None
        self.on_new: Callable[[], None] = lambda: None
        self.arm_session = session
        self.record_writer = recorder
        self._pointing = pointing
        self.estimator_now = estimator
        self._silence_s = silence_s
        self._lock = Lock()  # of what the page sets
        self._values = settings.defaults()
        self._tracker = POSE
        self._clutch = False
        self._record = False
        self._heard_s = time.monotonic()
        self._drawn_s = -np.inf  # when the page has drawn a round
        self._demonstrates = False
        self._player: Demonstration | None = None  # from the first round of a demonstration on
        self._asked = deque[Callable[[], None]]()  # of the pointing task, for the next round
        self.parameters_now = FollowParameters()
        self._settle(self._values, POSE)
        self._state = posetracker.start(time.monotonic())
        self._paper: tracker.TrackerState | None = None
        self._delayed = deque[Sample]()
        self._before = Now()
        self._notes = deque[str](maxlen=NOTES)
        self.latest_frames: Latest | None = None
        self._tracked: Tracked | None = None
        self._times_s = deque[float](maxlen=30)
        self._t_s = time.monotonic()
        self._stopped = Event()
        self._thread = Thread(target=self.run_loop, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """Stop: the arm holds, and a recording is written to its end."""
        self._stopped.set()
        self._thread.join()
        self.record_writer.close()

    def set(self, name: object, value: object) -> None:
        """Set a slider. Raises ValueError, see `settings.checked`."""
        number = settings.checked(name, value)
        with self._lock:
            self._values = {**self._values, str(name): number}

    def follow_by(self, name: object) -> None:
        """Choose the tracker; chosen again, the paper's takes the next frame for the empty scene.

        Raises ValueError for another name.
        """
        if name not in (POSE, PAPER):
            raise ValueError(f"tracker: expected {POSE} or {PAPER}, got {name!r}")
        with self._lock:
            self._tracker = str(name)
            self._paper = None

    def clutch(self, closed: bool) -> None:
        """Close or open the clutch."""
        with self._lock:
            self._heard_s = time.monotonic()
            self._clutch = bool(closed)

    def record(self, on: bool) -> None:
        """Start or stop a recording."""
        with self._lock:
            self._record = bool(on)

    def heard(self, number: int) -> None:
        """The page has drawn a round."""
        now = time.monotonic()
        with self._lock:
            self._heard_s = self._drawn_s = now
        self._asked.append(lambda: self._pointing.drawn(number, now))

    def begin_task(self, operator: object, repeats: object) -> None:
        """Begin the pointing task, with the clutch open and the simulated hand in the middle; the
        page is told if that cannot be.
        """
        now = time.monotonic()
        self._asked.append(lambda: self._pointing.begin(operator, repeats, now))
        self.clutch(False)
        if self.source.hand is not None:
            self.source.hand.go_home()

    def end_task(self) -> None:
        """End the pointing task."""
        self._asked.append(self._pointing.end)

    def press(self) -> None:
        """The person says that the tool is on the target."""
        now = time.monotonic()
        self._asked.append(lambda: self._pointing.press(self._tool(), self._values, now))

    def demonstrate(self) -> None:
        """Let the simulated hand play the pointing task, at scale 1 and without a delay, until
        `touch`; a person's task ends. Raises ValueError if there is no such hand.
        """
        if self.source.hand is None:
            raise ValueError("demonstration: there is no simulated hand")
        fresh = settings.defaults()
        with self._lock:
            self._demonstrates = True
            self._player = None
            self._values = {**self._values, **{k: fresh[k] for k in ("scale", "delay_ms")}}

    def touch(self) -> None:
        """A person does something: a demonstration ends, and the simulated hand goes on by
        itself.
        """
        with self._lock:
            if not self._demonstrates:
                return
            self._demonstrates = False
            self._player = None
            self._clutch = False
        if self.source.hand is not None:
            self.source.hand.by_itself = True
        self.end_task()

    def note(self, words: str) -> None:
        """Show words among what has happened."""
        self._notes.append(f"{time.strftime('%H:%M:%S')} {words}")

    def run_loop(self) -> None:
        try:
            while not self._stopped.is_set():
                self.go_round()
        except Exception as error:  # whatever it is, the page says it, and the command ends
            self.failed = error
        self.on_new()

    def go_round(self) -> None:
        latest = self.source.next(WAIT_S)
        begin = time.monotonic()
        with self._lock:
            values, follower, record = self._values, self._tracker, self._record
            silent = self._clutch and begin - self._heard_s > self._silence_s
            self._clutch = self._clutch and not silent
            clutch = self._clutch
        while self._asked:
            self._asked.popleft()()
        if silent:
            self.note(f"the page did not answer for {self._silence_s:g} s: clutch opened")
        self._settle(values, follower)
        if latest is not None:
            self.latest_frames = latest
            self._tracked = self.follow(latest, follower)
            self._times_s.append(latest.arrived_s)
        tracked_s = time.monotonic()
        troubles = self.source.troubles()
        moment = self._move(latest, troubles, clutch)
        moved_s = time.monotonic()
        self.keep(latest, record, clutch)
        arrived = begin if latest is None else latest.arrived_s
        stages = Stages(
            1e3 * (begin - arrived), 1e3 * (tracked_s - begin), 1e3 * (moved_s - tracked_s)
        )
        number = (self.newest.number if self.newest else 0) + 1
        coupled = moment.state.origin is not None
        task = self._pointing.step(self._tool(), coupled, values, number, moved_s)
        playing = self._play(task, moment.state.held, values["scale"], moved_s)
        self.newest = Shown(
            number,
            self.latest_frames,
            latest is not None,
            self._tracked,
            moment,
            arm_points(self.arm_session),
            body_poses(self.arm_session),
            clutch,
            troubles,
            list(self._notes),
            (self.record_writer.running, self.record_writer.status),
            self.record_writer.finished,
            self._rate(begin),
            stages,
            follower,
            values,
            task,
            self._pointing.status,
            playing,
        )
        self.on_new()

    def _play(self, task: Doing | None, held: str, scale: float, t_s: float) -> bool:
        """A round of the demonstration, if there is one and a page that shows it; whether there is
        one.
        """
        hand = self.source.hand
        with self._lock:
            if not self._demonstrates or hand is None:
                return False
            if self._player is None:  # a task that goes on is somebody else's
                self._pointing.end()
                self._player = Demonstration()
                return True
            if t_s - self._drawn_s > self._silence_s:
                return True
            at_mm = float(hand.goal.translation[0])
            act = self._player.step(Seen(t_s, task, bool(held), scale, at_mm))
            self._clutch = act.clutch
            if task is not None:
                hand.move([act.hand_mm - at_mm, 0.0, 0.0], [0.0, 0.0, 0.0])
        if act.begin:
            self._pointing.begin(NAME, 1, t_s, logged=False)
            hand.go_home()
        if act.press:
            self._pointing.press(self._tool(), self._values, t_s)
        return True

    def _settle(self, values: Values, follower: str) -> None:
        """Give the sliders' values to tracker and mapping."""
        estimator = "paper" if follower == PAPER else self.estimator_now
        self.parameters_now = settings.follow_parameters(values, self.source.rig, estimator)
        before = self.arm_session.mapping
        self.arm_session.mapping = settings.mapping_parameters(values, before)
        if self.arm_session.mapping.scale != before.scale and self.arm_session.state is not None:
            # the tool goes on from where it is, and does not jump to where it would have been
            self.arm_session.state = self.arm_session.state._replace(origin=None)

    def follow(self, latest: Latest, follower: str) -> Tracked:
        """The tracker's step."""
        rig, handle, p = self.source.rig, self.source.handle, self.parameters_now
        if follower == POSE:
            t_s = max(latest.t_s, np.nextafter(self._state.t_s, np.inf))
            self._state, tracked = posetracker.step(self._state, latest.images, t_s, rig, handle, p)
            return tracked
        state = self._paper or tracker.start(latest.images, rig, latest.t_s - WAIT_S)
        t_s = max(latest.t_s, np.nextafter(state.t_s, np.inf))
        state, measurement = tracker.step(state, latest.images, t_s, rig, handle, p)
        with self._lock:
            self._paper = state if self._tracker == PAPER else None
        return Tracked(measurement, tuple(camera.window for camera in state.cameras))

    def _move(self, latest: Latest | None, troubles: list[str], clutch: bool) -> Moment:
        """The session's step with the sample that is due."""
        t_s = time.monotonic() if latest is None else latest.t_s
        self._t_s = max(t_s, np.nextafter(self._t_s, np.inf))
        pose = None if self._tracked is None else self._tracked.measurement.pose
        gone = (
            self.latest_frames is None
            or time.monotonic() - self.latest_frames.arrived_s > NO_FRAME_S
        )
        if troubles or pose is None or (latest is None and gone):
            self._delayed.clear()  # the arm holds now, and not when the delay is over
        sample = Sample(self._t_s, None, "lost", clutch)
        if latest is not None:  # an old pose is not measured once more
            if not troubles and pose is not None:
                sample = Sample(self._t_s, pose.T_world_handle, pose.status, clutch)
            sample = self._due(sample)
        moment = self.arm_session.step(sample)
        touching = bool(np.linalg.norm(moment.reading.force) > TOUCHED_N)
        now = Now(clutch, moment.state.held, moment.limits, touching, self._values["scale"])
        for event in changes(self._t_s, self._before, now):
            self.note(f"{event.event}: {event.detail}" if event.detail else event.event)
        self._before = now
        return moment

    def _due(self, sample: Sample) -> Sample:
        """The sample that is as old as the added delay, at the time of the newest one; what opens
        the clutch is not delayed.

        While the delay grows the same sample is given again.
        """
        due_s = sample.t_s - 1e-3 * self._values["delay_ms"]
        self._delayed.append(sample)
        while len(self._delayed) > 1 and self._delayed[1].t_s <= due_s:
            self._delayed.popleft()
        due = self._delayed[0]
        if due.t_s < due_s:  # frames are no clock: the delay ends between two of them
            due = between(due, self._delayed[1], due_s, self.arm_session.mapping)
        return due._replace(t_s=sample.t_s, clutch=due.clutch and sample.clutch)

    def keep(self, latest: Latest | None, record: bool, clutch: bool) -> None:
        """Record the frames, if they are wanted."""
        if record and not self.record_writer.running:
            self.record_writer.start()
            with self._lock:
                self._record = self.record_writer.running
        elif not record:
            self.record_writer.stop()
        if latest is not None:
            self.record_writer.add(Taken(latest.t_s, latest.spread_s, latest.images), clutch)
            if record and not self.record_writer.running:  # it has failed
                with self._lock:
                    self._record = False

    def _tool(self) -> Array:
        """Where the arm's tool is, mm, base frame."""
        return self.arm_session.slave.read().tool.translation

    def _rate(self, now: float) -> float:
        """Frames a second, over the last ones."""
        if len(self._times_s) < 2 or now - self._times_s[-1] > 1.0:
            return 0.0
        return (len(self._times_s) - 1) / max(self._times_s[-1] - self._times_s[0], 1e-9)


def between(before: Sample, after: Sample, t_s: float, p: MappingParameters) -> Sample:
    """The sample at a time between two others; the first one where no hand goes from one to the
    other, so that the mapping sees the jump.
    """
    first, second = before.T_world_handle, after.T_world_handle
    dt = after.t_s - before.t_s
    if first is None or second is None:
        return before
    if apart(second, first, p.hand_mm_s * dt, p.hand_rad_s * dt):
        return before
    share = (t_s - before.t_s) / dt
    return before._replace(T_world_handle=shifted(first, share * motion_between(second, first)))
