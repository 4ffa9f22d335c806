"""The bridge on the real controller and the plant, in lockstep: what moves, what ends it, and after how many ticks."""

import json

import numpy as np
import pytest

from rtctl.client import Reply
from rtctl.commands import CommandRefused, Reason, Verb
from rtctl.lifecycle import Condition, Operating, Task
from rtctl.operator.follower import Follower
from rtctl.operator.link import Link
from rtctl.operator.message import Button
from rtctl.operator.motion import Limits, Projection

AGE_TICKS, STREAM_TICKS = 80, 50
JERK_MM_PER_S3 = 400.0
MESSAGE_TICKS = 10


class Direct:
    """A controller without a network between."""

    def __init__(self, rig):
        self.rig = rig

    def command(self, verb, *arguments, **_options):
        verdict = self.rig.order(verb, *arguments)
        if verdict is not Reason.ACCEPTED:
            raise CommandRefused(verdict.name.lower(), verdict.name)
        return Reply(int(self.rig.last["tick"]))

    def stop(self):
        return self.command(Verb.STOP)

    def latest(self):
        return self.rig.last


class Console:
    """A person who drives the rig; time is that of its ticks."""

    def __init__(self, rig):
        self.rig, self.told, self.sequence = rig, [], 0
        self.link = Link(AGE_TICKS / 1000)
        limits = Limits(speed_mm_per_s=3.0, speed_rad_per_s=0.1)
        projection = Projection("planar_3rpr", limits)
        self.follower = Follower(Direct(rig), self.link, projection, self.told.append, stage=3)
        self.hold(seconds=0.1, deadman=False)

    @property
    def now_s(self):
        return int(self.rig.last["tick"]) / 1000

    def hold(self, *twist, seconds, buttons=0, deadman=True, frame="base"):
        """Say the same for some time."""
        for _ in range(round(seconds * 1000 / MESSAGE_TICKS)):
            self.sequence += 1
            unix_ns = round(self.now_s * 1e9) + 10**18
            fields = {
                "version": 1, "source": "console", "sequence": self.sequence, "timestamp_ns": unix_ns, "frame": frame,
                "twist": [*twist, 0, 0, 0, 0, 0, 0][:6], "buttons": buttons, "deadman": deadman,
            }  # fmt: skip
            self.link.receive(json.dumps(fields).encode(), self.now_s, unix_ns)
            self.follower.step(self.now_s)
            self.rig.run(MESSAGE_TICKS)
        return self.rig.last

    def silence(self, ticks):
        """No message any more; the bridge goes on."""
        for _ in range(ticks):
            self.follower.step(self.now_s)
            self.rig.run(1)

    def press(self, button):
        self.hold(seconds=0.01, buttons=button)


@pytest.fixture
def console(homed):
    return Console(homed)


def ticks_to_rest(rows):
    """Ticks until the desired pose moves no more; it does at the beginning of `rows`."""
    speed = np.abs(np.diff(rows["pose_desired"], axis=0)).max(axis=1) * 1000
    assert speed[0] > 2.0
    assert speed[-1] < 1e-6
    return int(np.flatnonzero(speed > 1e-6)[-1]) + 1


BRAKE_TICKS = round(2000 * (3.0 / JERK_MM_PER_S3) ** 0.5)


def test_the_robot_moves_as_the_twist_says_and_holds_still_with_a_centred_stick(console):
    before = console.rig.last["pose_desired"].copy()
    console.hold(3.0, -1.5, 0, 0, 0, 0.05, seconds=1.0)
    moved = console.rig.last["pose_desired"] - before
    assert moved[0] == pytest.approx(3.0, abs=0.4)
    assert moved[1:] / moved[0] == pytest.approx([-0.5, 0.05 / 3.0], rel=0.25)
    console.hold(seconds=0.5)
    at = console.rig.last["pose_desired"].copy()
    console.hold(seconds=0.5)
    np.testing.assert_allclose(console.rig.last["pose_desired"], at, atol=1e-9)


def released(console):
    console.hold(seconds=0.01, deadman=False)
    return 0


def silent(console):
    console.silence(AGE_TICKS + 5)
    return AGE_TICKS


def bridge_dead(_console):
    return STREAM_TICKS + 1


@pytest.mark.parametrize("end", [released, silent, bridge_dead])
def test_every_end_is_a_jerk_limited_brake_after_so_many_ticks(console, end):
    console.hold(3.0, seconds=1.0)
    first = len(console.rig.rows)
    notice = end(console)
    console.rig.run(500)
    rows = console.rig.rows[first - 1 :]
    assert ticks_to_rest(rows) == pytest.approx(notice + BRAKE_TICKS, abs=MESSAGE_TICKS + 10)
    jerk = np.abs(np.diff(rows["pose_desired"][:, 0], 3)).max() / 1e-9
    assert jerk < 1.02 * JERK_MM_PER_S3
    silent_stream = rows["condition_active"] >> Condition.STREAM_SILENT & 1
    assert silent_stream.any() == (end is bridge_dead), "a bridge that lives ends its stream in order"
    assert console.rig.last["operating_state"] == Operating.ENABLED


def test_at_the_end_of_the_workspace_the_controller_brakes_once_and_the_hand_must_let_go(console):
    console.hold(3.0, seconds=20.0)
    rows = console.rig.rows
    robot = console.rig.robot
    assert rows["pose_desired"][-1, 0] > 165.0
    assert (rows["pose_desired"] <= robot.record["box_high"][0]).all()
    ends = np.diff((rows["condition_active"] >> Condition.WORKSPACE & 1).astype(int)) == 1
    assert ends.sum() == 1, "no trembling against the border"
    assert console.told == ["the controller did not follow: it ended the motion (workspace)"]
    console.hold(seconds=0.1, deadman=False)
    before = float(console.rig.last["pose_desired"][0])
    console.hold(-3.0, seconds=1.0)
    assert console.rig.last["pose_desired"][0] < before - 2.0, "the way back is open"


@pytest.fixture
def at_entry(entry):
    return Console(entry)


def depth(console):
    return float(console.rig.last["depth_mm"])


def test_presses_insert_step_by_step_and_retract(at_entry):
    for steps in (1, 2, 3):
        at_entry.press(Button.INSERT)
        at_entry.hold(seconds=3.0)
        assert depth(at_entry) == pytest.approx(0.25 * steps, abs=1e-6)
        assert at_entry.rig.last["task_state"] == Task.HOLDING
    at_entry.hold(seconds=0.2, deadman=False)
    assert at_entry.rig.last["operating_state"] == Operating.ENABLED, "there was nothing to pause"
    at_entry.hold(seconds=0.1)
    at_entry.press(Button.RETRACT)
    at_entry.hold(seconds=3.0)
    assert depth(at_entry) == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("end", [released, silent])
def test_a_step_pauses_without_the_deadman_and_resumes_with_it(at_entry, end):
    at_entry.press(Button.INSERT)
    at_entry.hold(seconds=0.2)
    assert 0 < depth(at_entry) < 0.2
    end(at_entry)
    at_entry.rig.run(1000)
    stopped_at = depth(at_entry)
    assert stopped_at < 0.25
    assert at_entry.rig.last["operating_state"] == Operating.PAUSED
    at_entry.hold(seconds=0.1, deadman=False)
    at_entry.hold(seconds=0.5)
    assert depth(at_entry) == stopped_at, "the deadman alone resumes nothing"
    at_entry.press(Button.RESUME)
    at_entry.hold(seconds=3.0)
    assert depth(at_entry) == pytest.approx(0.25, abs=1e-6)


def test_a_stop_ends_the_step_but_not_the_insertion(at_entry):
    at_entry.press(Button.INSERT)
    at_entry.hold(seconds=0.2)
    at_entry.press(Button.STOP)
    at_entry.hold(seconds=1.0, deadman=False)
    assert at_entry.rig.last["operating_state"] == Operating.ENABLED
    assert at_entry.rig.last["task_state"] == Task.HOLDING
    stopped_at = depth(at_entry)
    at_entry.hold(seconds=0.1)
    at_entry.press(Button.INSERT)
    at_entry.hold(seconds=3.0)
    assert depth(at_entry) == pytest.approx(stopped_at + 0.25, abs=1e-6)


def test_a_twist_inside_the_cochlea_is_refused_and_does_not_end_the_insertion(at_entry):
    at_entry.press(Button.INSERT)
    at_entry.hold(seconds=3.0)
    pose = at_entry.rig.last["pose_desired"].copy()
    at_entry.hold(1.0, seconds=0.5)
    at_entry.hold(seconds=0.1, deadman=False)
    np.testing.assert_allclose(at_entry.rig.last["pose_desired"], pose, atol=1e-9)
    assert at_entry.rig.last["task_state"] == Task.HOLDING
    assert "INSERTED" in at_entry.told[0]
    at_entry.hold(seconds=0.1)
    at_entry.press(Button.INSERT)
    at_entry.hold(seconds=3.0)
    assert depth(at_entry) == pytest.approx(0.5, abs=1e-6)
