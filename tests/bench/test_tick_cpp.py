"""The tick in C++ is a second implementation of the controller: both must agree to the bit, whatever comes in."""

import numpy as np
import pytest

from bench.native import NativeTick, compiler
from bench.recorded import differing_fields, drive, record_insertion
from bench.tick_cost import check_equal
from hal.frames import FROZEN, INVALID, SATURATED
from rtctl.commands import COMMAND, Reason, Verb
from rtctl.controller import Controller
from rtctl.device_clock import ClockState
from rtctl.exchange.control import (
    ALIVE,
    ARMING_ALLOWED,
    GATEWAY_EXPECTED,
    LOG_WRITING,
    OPERATOR_EXPECTED,
    OPERATOR_PRESENT,
)
from rtctl.lifecycle import Condition, Motion, Operating
from rtctl.settings import load

pytestmark = pytest.mark.skipif(compiler() is None, reason="no g++ on this machine")


@pytest.fixture(scope="module")
def settings():
    return load("planar-sim", ["workflow.hold_s=0.1"])


@pytest.fixture(scope="module")
def native(settings, tmp_path_factory):
    return NativeTick(Controller(settings), tmp_path_factory.mktemp("native"))


@pytest.fixture(scope="module")
def pieces(settings):
    return record_insertion(settings, 3)


def test_an_insertion_is_the_same_to_the_bit(pieces, native):
    assert {p.verb for p in pieces} >= {Verb.ENABLE, Verb.HOME, Verb.UNBIAS, Verb.LOAD_PLAN, Verb.INSERT, Verb.STOP}
    for piece in pieces:
        check_equal(piece.first(2000), native.drive)


class Twins:
    """The same memory in both implementations, ticked side by side."""

    def __init__(self, settings, native, memory, sensors):
        self.native = native
        self.controller = Controller(settings)
        self.controller.memory[:] = memory
        self.controller.sensors[:] = sensors
        self.tick = int(memory["state"]["tick"][0])
        self.seen = []

    def step(self, command, health, missed, clock_state):
        c = self.controller
        self.tick += 1 + missed
        c.order(command)
        c.propose(self.tick)
        records: np.ndarray = np.zeros((2, 1), c.record.dtype)
        records["tick"], records["gateway_health"], records["missed_ticks"] = self.tick, health, missed
        records["clock_state"] = clock_state
        memories, actuators = np.repeat(c.memory[None], 2, 0), np.zeros((2, 1), c.actuators.dtype)
        drive(memories[0], c.sensors, actuators[0], records[0])
        self.native.drive(memories[1], c.sensors, actuators[1], records[1])
        states = memories["state"].copy()
        states["scratch"] = 0.0  # each has its own way to use it
        assert differing_fields(*records) == [], f"tick {self.tick}"
        assert differing_fields(*actuators) == [], f"tick {self.tick}"
        assert differing_fields(*states) == [], f"tick {self.tick}"
        for part in ("profile", "plan", "parameters"):
            assert memories[0][part].tobytes() == memories[1][part].tobytes(), f"{part} at tick {self.tick}"
        c.memory[:] = memories[0]
        self.seen.append(records[0, 0])
        return records[0, 0]


WELL = ALIVE | LOG_WRITING | OPERATOR_PRESENT | OPERATOR_EXPECTED | GATEWAY_EXPECTED | ARMING_ALLOWED
STREAMS = {Motion.SERVO_CP: Verb.SERVO_CP, Motion.SERVO_CV: Verb.SERVO_CV}
VERBS = [*map(int, Verb), 25, -3]
RARE = (Verb.DISABLE, Verb.HOME, Verb.UNLOAD_ARRAY, Verb.LOAD_ARRAY, Verb.UNBIAS, Verb.LOAD_PLAN)
"""After these most others are refused."""
OFTEN = (Verb.SERVO_CV, Verb.INSERT)
SHARES = np.array([0.4 if v in RARE else 4.0 if v in OFTEN else 1.0 for v in VERBS])
SHARES /= SHARES.sum()


class Adversary:
    """Draws commands, sensor frames and gateway health that no test bench would ever produce in that order."""

    def __init__(self, seed, sensors):
        self.random = np.random.default_rng(seed)
        self.frames, self.at = sensors, 0
        self.fault, self.fault_left = None, 0
        self.health, self.gaps = WELL, 0.0
        self.way = self.random.normal(0.0, (5.0, 5.0, 0.2))

    def sensors(self, now):
        """The next recorded frame; with a homing under way the motors stand still, with a fault it is spoilt."""
        if now["motion"] != Motion.HOME:
            self.at = (self.at + 1) % len(self.frames)
        frame = self.frames[self.at : self.at + 1].copy()
        if self.fault_left == 0 and self.random.random() < 0.003:
            self.fault = self.random.choice(
                ["axes", "wrench", "wrench", "impedance", "power", "watchdog", "amplifier", "force", "jump"]
            )
            self.fault_left = int(self.random.integers(1, 30))
        elif self.fault_left > 0:
            self.fault_left -= 1
        if self.fault_left == 0:
            return frame
        if self.fault == "axes":
            frame["axes_validity"], frame["axis_angle_rad"], frame["axes_age_ticks"] = INVALID, np.nan, 1
        elif self.fault == "wrench":
            frame["wrench_validity"], frame["wrench_in_sensor"] = self.random.choice([FROZEN, SATURATED]), np.nan
        elif self.fault == "impedance":
            frame["impedance_validity"], frame["impedance_ohm"], frame["impedance_pair"] = INVALID, np.nan, -1
        elif self.fault == "power":
            frame["powered"] = 0
        elif self.fault == "force":
            frame["wrench_in_sensor"] += 5.0
        elif self.fault == "jump":
            frame["axis_angle_rad"] += self.random.choice([5.0, 3000.0, -3000.0], frame["axis_angle_rad"].shape)
        else:
            frame["watchdog_tripped" if self.fault == "watchdog" else "amplifier_fault"] = 1
        return frame

    def gateway(self):
        """All is well most of the time; else one of the bits is missing for a while."""
        if self.random.random() < (0.003 if self.health == WELL else 0.05):
            bits = (ALIVE, LOG_WRITING, OPERATOR_PRESENT, ARMING_ALLOWED, GATEWAY_EXPECTED)
            self.health = WELL & ~int(self.random.choice(bits)) if self.health == WELL else WELL
        return self.health

    def missed(self):
        """A gap now and then, and more often soon after one."""
        self.gaps = 0.1 if self.random.random() < 0.003 else self.gaps * 0.97
        return int(self.random.choice([1, 2, 500])) if self.random.random() < 0.003 + self.gaps else 0

    def clock_state(self):
        return int(self.random.choice(ClockState)) if self.random.random() < 0.01 else 0

    def command(self, state, tick):
        """Mostly none; else any verb with arguments that fit it more often than not."""
        share = {Motion.HOME: 0.002, Motion.SERVO_CP: 0.03, Motion.SERVO_CV: 0.03}.get(state["motion"], 0.05)
        if self.random.random() > share:
            return None
        row = np.zeros(1, COMMAND)[0]
        verb = self.random.choice(VERBS, p=SHARES)
        operating = state["operating"]
        if operating == Operating.FAULT and self.random.random() < 0.8:
            verb = Verb.ACKNOWLEDGE
        elif operating == Operating.DISABLED and self.random.random() < 0.8:
            verb = Verb.ENABLE
        elif operating == Operating.PAUSED and self.random.random() < 0.7:
            verb = self.random.choice([Verb.RESUME, Verb.RETRACT])
        elif state["motion"] in STREAMS and self.random.random() < 0.5:
            verb = STREAMS[state["motion"]]
        elif not state["homed"] and self.random.random() < 0.5:
            verb = Verb.HOME
        row["verb"], row["sequence"], row["source"] = verb, tick, 7
        row["deadline_tick"] = tick + (-2 if self.random.random() < 0.05 else 100)
        if verb in (Verb.MOVE_CP, Verb.SERVO_CP):
            row["argument"][:3] = np.nan_to_num(state["setpoint"][:3]) + self.random.normal(0.0, (1.0, 1.0, 0.02))
        elif verb == Verb.SERVO_CV:
            row["argument"][:3] = self.way + self.random.normal(0.0, (0.2, 0.2, 0.02))
        elif verb in (Verb.INSERT, Verb.RETRACT):
            ahead = self.random.exponential(2.0) * (1.0 if verb == Verb.INSERT else -1.0)
            row["argument"][:2] = np.clip(state["setpoint"][3] + ahead, 0.0, 15.0), self.random.uniform(0.1, 3.0)
        elif verb in (Verb.LOAD_PLAN, Verb.SET_PARAMETERS):
            row["argument"][0] = self.random.choice([1, 2])
        if self.random.random() < 0.05:
            row["argument"][self.random.integers(8)] = np.nan
        return row


def begin(settings, native, piece, skipped, seed):
    """Twins some ticks after the begin of a piece, with other parameters staged, and an adversary."""
    memory, records = piece.memory.copy(), piece.first(skipped).inputs()
    drive(memory, piece.sensors[:skipped], np.zeros_like(piece.actuators[:skipped]), records)
    if seed % 3:  # recorded motors do not follow, and that shall not end every motion
        memory["parameters"]["following_error_rad"] = 1e9
    parameters = memory["parameters"]
    if seed % 5 == 0:
        parameters["overrun_window_ticks"], parameters["overrun_window_limit"], parameters["overrun_windows"] = (
            20,
            1,
            1 + seed % 2,
        )
    else:  # a second of rest after every gap would be most of what there is to see
        parameters["overrun_window_limit"] = parameters["overrun_window_ticks"]
    if seed % 4 == 3:  # a small room, so that insertions and streams come to its walls
        for field, side in (("box_low", -1.0), ("box_high", 1.0)):
            memory["robot"][field] = memory["state"]["reference"] + side * np.array((0.5, 0.5, 0.05))
    staged = memory["staged_parameters"]
    staged[:] = memory["parameters"]
    staged["number"], staged["stylet_on"], staged["project_first"], staged["lateral_limit_mm"] = 2, 1, 0, 0.02
    staged["filter_b"], staged["stylet_stroke_mm"] = staged["filter_b"] * 1.5, 3.0
    staged["moving_average"], staged["window_ticks"] = seed % 2, 7 + seed
    twins = Twins(settings, native, memory, piece.sensors[:1])
    twins.tick = int(piece.records["tick"][0]) + skipped
    return twins, Adversary(seed, piece.sensors[skipped:])


def test_whatever_comes_in_both_do_the_same(settings, native, pieces):
    seen = []
    starts = [
        (Verb.HOME, 0),
        (Verb.LOAD_ARRAY, 0),
        (Verb.LOAD_PLAN, 0),
        (Verb.APPROACH, 100),
        (Verb.INSERT, 500),
        (Verb.INSERT, 8000),
    ]
    for seed in range(30):
        verb, skipped = starts[seed % len(starts)]
        piece = next(p for p in pieces if p.verb == verb)
        twins, adversary = begin(settings, native, piece, skipped, seed)
        state = twins.controller.memory["state"][0]
        for _ in range(500):
            twins.controller.sensors[:] = adversary.sensors(state)
            command, health = adversary.command(state, twins.tick + 1), adversary.gateway()
            twins.step(command, health, adversary.missed(), adversary.clock_state())
        seen += twins.seen
    records = np.array(seen)
    # the test is worth something only if it got around
    accepted = set(records["command_verb"][records["command_verdict"] == Reason.ACCEPTED].tolist())
    raised = [c for c in Condition if (records["condition_active"] >> c & 1).any()]
    assert len(accepted) >= 13
    assert len(set(records["command_verdict"].tolist())) >= 12
    assert len(raised) >= 11
    wanted = {Condition.WORKSPACE, Condition.OVERRUN_PERSISTENT, Condition.OVERRUN_UNABATED, Condition.DEVICE_CLOCK}
    assert wanted <= set(raised)
    assert set(records["operating_state"].tolist()) == set(Operating)
    for field in ("motion", "task_state"):
        assert len(set(records[field].tolist())) >= 6
