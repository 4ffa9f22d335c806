"""The bridge with a controller that only writes down what it is asked."""

import json
import threading
import time

import numpy as np
import pytest

from hal.errors import RtctlError
from rtctl import robots
from rtctl.client import NoReply, Reply
from rtctl.commands import CommandRefused, Verb
from rtctl.lifecycle import Condition, Motion
from rtctl.operator.follower import PERIOD_S, Follower
from rtctl.operator.link import Link
from rtctl.operator.message import Button
from rtctl.operator.motion import STAGES, TURNS, Limits, Projection

LIMIT_S = 0.08
LIMITS = Limits(speed_mm_per_s=2.0, speed_rad_per_s=0.1)


class Controller:
    """Records commands; `failure` is raised by the next one."""

    def __init__(self):
        self.asked, self.failure = [], None
        self.record = {
            "tick": 0, "is_busy": 0, "motion": Motion.SERVO_CV, "stop_cause": -1, "depth_mm": 3.0,
            "pose_measured": np.array([160.0, 0.0, 0.0]),
        }  # fmt: skip

    def command(self, verb, *arguments, valid_for_s=0.5):
        self.asked.append((verb, arguments, valid_for_s))
        if self.failure is not None:
            failure, self.failure = self.failure, None
            raise failure
        return Reply(self.record["tick"])

    def stop(self):
        return self.command(Verb.STOP)

    def latest(self):
        return self.record

    def verbs(self):
        verbs = [verb for verb, *_ in self.asked]
        self.asked.clear()
        return verbs


class Bench:
    """Operator, link, follower and controller on one clock; a message every 10 ms, a step after each."""

    def __init__(self, **options):
        self.link, self.controller, self.told = Link(LIMIT_S), Controller(), []
        projection = Projection("planar_3rpr", LIMITS)
        self.follower = Follower(
            self.controller, self.link, projection, self.told.append, **({"stage": len(STAGES) - 1} | options)
        )
        self.now_s, self.sequence = 50.0, 0

    def send(self, *, seconds=0.01, **changes):
        for _ in range(round(seconds / 0.01)):
            self.now_s += 0.01
            self.sequence += 1
            unix_ns = round(self.now_s * 1e9)
            fields = {
                "version": 1, "source": "hand", "sequence": self.sequence, "timestamp_ns": unix_ns, "frame": "base",
                "twist": [1.0, 0, 0, 0, 0, 0], "buttons": 0, "deadman": True,
            } | changes  # fmt: skip
            self.link.receive(json.dumps(fields).encode(), self.now_s, unix_ns)
            self.follower.step(self.now_s)
        return self

    def silent(self, seconds):
        for _ in range(round(seconds / 0.01)):
            self.now_s += 0.01
            self.follower.step(self.now_s)
        return self

    def follow(self):
        self.send(deadman=False).send(seconds=0.1)
        assert set(self.controller.verbs()) == {Verb.SERVO_CV}
        return self


def test_it_streams_at_a_fixed_rate_while_the_deadman_is_held_and_never_for_longer_than_the_message_is_fresh():
    bench = Bench()
    bench.send(deadman=False, seconds=0.2)
    assert bench.controller.asked == []
    bench.send(seconds=1.0)
    assert len(bench.controller.asked) == pytest.approx(1.0 / PERIOD_S, abs=1)
    for verb, rate, valid_s in bench.controller.asked:
        assert (verb, rate) == (Verb.SERVO_CV, (1.0, 0.0, 0.0))
        assert valid_s <= 0.05
    bench.controller.asked.clear()
    bench.silent(0.06)
    assert bench.controller.asked[-1][2] < 0.03, "it dies with the message behind it"


LOSSES = {
    "released": {"deadman": False},
    "second source": {"source": "other"},
    "order": {"sequence": 1},
    "late": {"timestamp_ns": 0},
    "future": {"timestamp_ns": 2**62},
    "not finite": {"twist": [float("nan"), 0, 0, 0, 0, 0]},
    "wrong length": {"twist": [1.0]},
    "huge": {"twist": [1e9, 0, 0, 0, 0, 0]},
}


@pytest.mark.parametrize("changes", LOSSES.values(), ids=LOSSES)
def test_a_loss_ends_the_stream_with_a_stop_and_holding_on_begins_no_other(changes):
    bench = Bench().follow()
    bench.send(**changes)
    assert bench.controller.verbs() == [Verb.STOP]
    if changes != {"deadman": False}:
        bench.send(seconds=0.5)
        assert bench.controller.verbs() == [], "held all the time"
    bench.send(deadman=False).send(seconds=0.1)
    assert set(bench.controller.verbs()) == {Verb.SERVO_CV}


def test_silence_ends_the_stream_within_the_age_limit_and_a_period():
    bench = Bench().follow()
    last_s = bench.now_s
    while Verb.STOP not in [verb for verb, *_ in bench.controller.asked]:
        bench.silent(0.01)
    assert bench.now_s - last_s <= LIMIT_S + 0.01
    assert bench.told == ["the operator's messages stopped coming"]


def test_a_frozen_bridge_that_goes_on_does_not_go_on_moving():
    bench = Bench().follow()
    bench.now_s += 3.0
    bench.follower.step(bench.now_s)
    assert bench.controller.verbs() == [Verb.STOP]
    bench.send(seconds=0.2)
    assert bench.controller.verbs() == []


@pytest.mark.parametrize(
    "failure",
    [CommandRefused("wrong_state", "not possible in the present state"), NoReply("no reply to servo_cv")],
    ids=["refused", "silent"],
)
def test_a_controller_that_does_not_follow_ends_the_stream_until_the_deadman_was_released(failure):
    bench = Bench().follow()
    bench.controller.failure = failure
    bench.send(seconds=0.3)
    assert bench.controller.verbs() == [Verb.SERVO_CV, Verb.STOP]
    assert failure.what in bench.told[-1]


def test_a_refused_beginning_sends_no_stop_because_a_stop_ends_an_insertion_that_holds():
    bench = Bench().send(deadman=False)
    bench.controller.failure = CommandRefused("inserted", "the array is 3 mm inside the cochlea")
    bench.send(seconds=0.3)
    assert bench.controller.verbs() == [Verb.SERVO_CV]


def test_a_command_that_came_too_late_is_skipped():
    bench = Bench().follow()
    bench.controller.failure = CommandRefused("expired", "too late")
    bench.send(seconds=0.2)
    assert set(bench.controller.verbs()) == {Verb.SERVO_CV}


def test_a_motion_that_the_controller_ended_is_not_begun_anew_until_the_deadman_was_released():
    bench = Bench().follow()
    bench.controller.record |= {"tick": 7, "motion": Motion.HOLD, "stop_cause": Condition.STREAM_SILENT}
    bench.send(seconds=0.3)
    assert bench.controller.verbs() == []
    assert bench.told == ["the controller did not follow: it ended the motion (stream_silent)"]
    bench.send(deadman=False).send(seconds=0.01)
    assert bench.controller.verbs() == [Verb.SERVO_CV]


def test_a_record_older_than_the_command_says_nothing_about_it():
    bench = Bench().send(deadman=False)
    bench.controller.record |= {"tick": 7, "motion": Motion.HOLD}
    bench.controller.command = lambda verb, *_, **__: bench.controller.asked.append((verb,)) or Reply(8)
    bench.send(seconds=0.2)
    assert len(bench.controller.asked) >= 9


def test_a_stop_nobody_confirms_is_told_and_harms_nothing():
    bench = Bench().follow()
    bench.controller.failure = NoReply("no reply to stop")
    bench.send(deadman=False)
    assert "stops by itself" in bench.told[0]
    bench.send(seconds=0.1)
    assert set(bench.controller.verbs()) == {Verb.STOP, Verb.SERVO_CV}


def test_a_centred_stick_begins_no_stream_but_ends_none_either():
    bench = Bench().send(deadman=False).send(seconds=0.2, twist=[0.01, 0, 0, 0.001, 0, 0])
    assert bench.controller.verbs() == []
    bench.send(seconds=0.1).send(seconds=0.1, twist=[0] * 6)
    assert bench.controller.asked[-1][:2] == (Verb.SERVO_CV, (0.0, 0.0, 0.0))


def test_stop_acts_without_deadman_and_ends_the_stream():
    bench = Bench().send(buttons=Button.STOP, deadman=False)
    assert bench.controller.verbs() == [Verb.STOP]
    bench.follow().send(buttons=Button.STOP)
    assert bench.controller.verbs() == [Verb.STOP]
    bench.send(seconds=0.3)
    assert bench.controller.verbs() == []


def test_stages_scale_what_is_asked_and_end_at_both_ends():
    bench = Bench(stage=1).follow()
    for button, factor in [(Button.SLOWER, 0.1), (Button.SLOWER, 0.1), (Button.FASTER, 0.25), (Button.FASTER, 0.5)]:
        bench.send(buttons=button).send(seconds=0.05)
        assert bench.controller.asked[-1][1][0] == pytest.approx(factor)
    assert bench.told[-1] == "speed stage 3 of 4, 50%"


class Path:
    """A bench with the deadman held and the stick centred, and a motion that stays under way as long as it is told."""

    def __init__(self):
        self.bench = Bench(step_mm=0.25, path_speed_mm_per_s=0.8)
        self.bench.send(deadman=False).send(twist=[0] * 6)

    def press(self, button, busy):
        record = self.bench.controller.record
        record["tick"] += 100
        record["is_busy"] = int(busy)
        self.bench.send(twist=[0] * 6, buttons=button).send(seconds=0.1, twist=[0] * 6)
        return self.bench.controller


@pytest.mark.parametrize(
    ("button", "verb", "arguments"),
    [
        (Button.INSERT, Verb.INSERT, (3.25, 0.8)),
        (Button.RETRACT, Verb.RETRACT, (2.75, 0.8)),
        (Button.RESUME, Verb.RESUME, ()),
    ],
)
def test_a_press_moves_one_step_along_the_path_and_the_deadman_pauses_it(button, verb, arguments):
    path = Path()
    assert path.press(button, busy=True).asked == [(verb, arguments, 0.05)]
    path.bench.send(seconds=0.1)
    assert path.bench.controller.verbs() == [verb], "the stick does nothing meanwhile"
    path.bench.send(deadman=False)
    assert path.bench.controller.verbs() == [Verb.PAUSE]
    path.bench.send(deadman=False, seconds=0.2)
    assert path.bench.controller.verbs() == []


def test_a_step_that_has_ended_is_not_paused():
    path = Path()
    path.press(Button.INSERT, busy=False).verbs()
    path.bench.send(deadman=False, seconds=0.1)
    assert path.bench.controller.verbs() == []


def test_silence_pauses_a_step():
    path = Path()
    path.press(Button.RETRACT, busy=True).verbs()
    path.bench.silent(LIMIT_S + 0.02)
    assert path.bench.controller.verbs() == [Verb.PAUSE]


def test_stop_ends_a_step_for_good():
    path = Path()
    path.press(Button.INSERT, busy=True).verbs()
    path.bench.send(buttons=Button.STOP).send(deadman=False)
    assert path.bench.controller.verbs() == [Verb.STOP]


def test_a_step_needs_the_deadman():
    bench = Bench().send(deadman=False).send(deadman=False, buttons=Button.INSERT)
    assert bench.controller.verbs() == []


def test_a_stream_is_ended_before_a_step_begins():
    bench = Bench().follow()
    bench.send(buttons=Button.INSERT)
    assert bench.controller.verbs() == [Verb.STOP, Verb.INSERT]


def test_what_leaves_the_plane_is_dropped_and_told_once():
    bench = Bench().send(deadman=False).send(seconds=0.5, twist=[1, 0, 1, 0.05, 0, 0])
    assert bench.controller.asked[-1][1] == (1.0, 0.0, 0.0)
    assert len(bench.told) == 1
    assert "dropped" in bench.told[0]


def test_nothing_moves_in_the_gripper_frame_while_its_pose_is_unknown():
    bench = Bench()
    bench.controller.record["pose_measured"][:] = np.nan
    bench.send(deadman=False).send(seconds=0.2, frame="gripper")
    assert bench.controller.verbs() == []
    assert "home the robot" in bench.told[-1]


def rate(twist, frame="base", phi=0.0, stage=1.0):
    return Projection("planar_3rpr", LIMITS).rate(np.array(twist, float), frame, np.array([160, 1, phi]), stage)[0]


def test_the_gripper_frame_turns_with_the_gripper():
    np.testing.assert_allclose(rate([1, 0, 0, 0, 0, 0.05], "gripper", np.pi / 2), [0, 1, 0.05], atol=1e-12)
    np.testing.assert_allclose(rate([0, 1, 0, 0, 0, 0], "gripper", np.pi / 6), [-0.5, np.sqrt(0.75), 0])
    np.testing.assert_allclose(rate([0, 1, 0, 0, 0, 0], "base", np.pi / 6), [0, 1, 0])


@pytest.mark.parametrize("kind", robots.KINDS)
@pytest.mark.parametrize("frame", ["base", "gripper"])
def test_every_robot_moves_and_turns_as_the_twist_says(kind, frame):
    """The twist of any motion of the robot, by differences of where its gripper is and how it is turned, gives that motion."""
    robot, step_s = robots.load(kind, {}), 1e-4
    low, high = robot.record["box_low"][0], robot.record["box_high"][0]
    pose = 0.3 * low + 0.7 * high
    rate = np.array([1.0, 0.02, -0.03, 0.04, -0.05, 0.06][: robot.dof])
    before, behind, ahead = (robot.rotation(pose + k * step_s * rate) for k in (0, -1, 1))
    spin = (ahead - behind) @ before.T / (2 * step_s)
    twist = np.zeros(6)
    twist[:3][np.array(robot.translation_mask)] = rate[: robot.length_dofs]
    twist[3:] = spin[2, 1], spin[0, 2], spin[1, 0]
    if frame == "gripper":
        twist = np.concatenate([before.T @ twist[:3], before.T @ twist[3:]])
    found, dropped = Projection(kind, LIMITS).rate(twist, frame, pose, 1.0)
    assert not dropped
    np.testing.assert_allclose(found, rate, atol=1e-8)


def test_limits_keep_the_direction_and_come_after_the_stage():
    np.testing.assert_allclose(rate([30, 40, 0, 0, 0, -5]), [1.2, 1.6, -0.1])
    np.testing.assert_allclose(rate([3, 4, 0, 0, 0, 0.2], stage=0.1), [0.3, 0.4, 0.02])
    np.testing.assert_allclose(
        rate([0, 1, 99, 0, 9, 0.01]), [0, 1, 0.01], err_msg="what is dropped takes no speed away"
    )
    np.testing.assert_array_equal(rate([0.01, 0.01, 0, 0, 0, 0.0019]), [0, 0, 0])


@pytest.mark.parametrize("kind", robots.KINDS)
def test_every_robot_there_is_can_be_driven(kind):
    robot = robots.load(kind, {})
    assert TURNS[kind](robot.home_pose).shape == (3, robot.dof - robot.length_dofs)


def test_an_unknown_robot_is_an_error_that_says_what_to_do():
    with pytest.raises(RtctlError, match="say in rtctl/operator"):
        Projection("delta", LIMITS)


class Loop:
    """A follower on a thread of its own, in real time."""

    def __init__(self):
        self.link, self.controller, self.ended, self.sequence = Link(LIMIT_S), Controller(), False, 0
        follower = Follower(self.controller, self.link, Projection("planar_3rpr", LIMITS), lambda _: None)
        self.thread = threading.Thread(target=follower.run, args=(lambda: self.ended,))
        self.thread.start()

    def send(self, deadman):
        self.sequence += 1
        fields = {
            "version": 1, "source": "hand", "sequence": self.sequence, "timestamp_ns": time.time_ns(), "frame": "base",
            "twist": [1.0, 0, 0, 0, 0, 0], "buttons": 0, "deadman": deadman,
        }  # fmt: skip
        self.link.receive(json.dumps(fields).encode(), time.monotonic(), time.time_ns())

    def follow(self):
        self.send(False)
        for _ in range(10):
            self.send(True)
            time.sleep(0.005)
        self.controller.asked.clear()

    def time_to_stop_s(self):
        begin_s = time.monotonic()
        while not any(verb == Verb.STOP for verb, *_ in list(self.controller.asked)):
            assert time.monotonic() < begin_s + 2.0
            time.sleep(0.0002)
        return time.monotonic() - begin_s


@pytest.fixture
def loop():
    made = Loop()
    yield made
    made.ended = True
    made.thread.join(2.0)


def test_the_loop_acts_on_a_release_at_once_and_on_silence_at_the_age_limit(loop):
    released, silent = [], []
    for _ in range(9):
        loop.follow()
        loop.send(False)
        released.append(loop.time_to_stop_s())
        loop.follow()
        loop.send(True)
        silent.append(loop.time_to_stop_s())
    assert np.median(released) < PERIOD_S / 4, "it does not wait for its next period"
    assert LIMIT_S - 0.005 < np.median(silent) < LIMIT_S + PERIOD_S / 4


def test_the_loop_leaves_nothing_moving_and_does_not_spin(loop):
    begin_s = time.process_time()
    time.sleep(0.5)
    assert time.process_time() - begin_s < 0.2
    loop.follow()
    loop.ended = True
    loop.thread.join(2.0)
    assert loop.controller.verbs()[-1] == Verb.STOP
