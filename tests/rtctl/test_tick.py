"""One tick at a time: what is refused and why, what conditions do, and that nothing but numbers reaches an actuator."""

import math

import numpy as np
import pytest

from hal.frames import INVALID
from hal.troubles import Grade, Trouble
from rtctl.commands import COMMAND, Reason, Verb
from rtctl.device_clock import ClockState
from rtctl.exchange.control import ALIVE, ARMING_ALLOWED, GATEWAY_EXPECTED, LOG_WRITING, OPERATOR_EXPECTED
from rtctl.lifecycle import TABLE, Condition, Motion, Operating, Reaction, Task
from rtctl.record import TIMING


class Bed:
    """A rig's controller and backend stepped one by one, so that a test may touch what passes between them."""

    def __init__(self, rig):
        self.c, self.backend, self.tick = rig.controller, rig.lockstep.backend, rig.lockstep.tick
        self.health = ARMING_ALLOWED
        self.missed = self.clock_state = 0

    def step(self, verb=Verb.NONE, *arguments, spoil=None, **command):
        c = self.c
        row = np.zeros(1, COMMAND)
        row["verb"], row["deadline_tick"] = verb, self.tick + 1
        row["argument"][0, : len(arguments)] = arguments
        for name, value in command.items():
            row[name] = value
        c.order(row[0])
        c.propose(self.tick)
        self.backend.read(self.tick, c.sensors)
        if spoil is not None:
            spoil(c)
        r = c.record
        r["tick"], r["time_ns"], r["gateway_health"], r["missed_ticks"] = self.tick, 0, self.health, self.missed
        r["clock_state"] = self.clock_state
        c.step()
        self.backend.write(self.tick, c.actuators)
        self.tick += 1
        return r[0].copy()

    def ask(self, verb, *arguments, **command):
        return Reason(int(self.step(verb, *arguments, **command)["command_verdict"]))

    def now(self):
        return Operating(int(self.c.record["operating_state"][0]))


@pytest.fixture
def bed(homed):
    return Bed(homed)


@pytest.fixture
def moving(bed):
    assert bed.ask(Verb.MOVE_CP, 168.0, -2.0, 0.05) is Reason.ACCEPTED
    for _ in range(600):
        bed.step()
    assert bed.c.record["is_busy"][0]
    return bed


@pytest.fixture
def inserting(entry):
    bed = Bed(entry)
    assert bed.ask(Verb.INSERT, 8.0, 2.0) is Reason.ACCEPTED
    for _ in range(1500):
        bed.step()
    assert bed.c.record["depth_mm"][0] > 1.0
    return bed


def active(record):
    return {Condition(c) for c in Condition if int(record["condition_active"]) >> c & 1}


def assert_off(bed, record):
    """Power is gone in this very tick, and every command is zero."""
    assert record["operating_state"] == Operating.FAULT
    assert bed.c.actuators["power"][0] == 0
    assert not bed.c.actuators["command_v"].any()
    assert not record["command_applied_v"].any()
    assert record["power_request"] == 0


# --- commands out of order -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("verb", "reason"),
    [
        (Verb.HOME, Reason.NO_POWER), (Verb.MOVE_CP, Reason.NO_POWER), (Verb.SERVO_CP, Reason.NO_POWER),
        (Verb.SERVO_CV, Reason.NO_POWER), (Verb.INSERT, Reason.NO_POWER), (Verb.RETRACT, Reason.NO_POWER),
        (Verb.APPROACH, Reason.NO_POWER), (Verb.REGISTER_ENTRY, Reason.NO_POWER), (Verb.UNBIAS, Reason.NO_POWER),
        (Verb.LOAD_ARRAY, Reason.NO_POWER), (Verb.PAUSE, Reason.WRONG_STATE), (Verb.RESUME, Reason.WRONG_STATE),
        (Verb.ACKNOWLEDGE, Reason.WRONG_STATE), (Verb.LOAD_PLAN, Reason.STALE_SLOT),
        (Verb.SET_PARAMETERS, Reason.STALE_SLOT), (Verb.STOP, Reason.ACCEPTED), (Verb.DISABLE, Reason.ACCEPTED),
        (Verb.UNLOAD_ARRAY, Reason.ACCEPTED), (Verb.ENABLE, Reason.ACCEPTED),
    ],
)  # fmt: skip
def test_what_a_disabled_controller_says(make_rig, verb, reason):
    assert Bed(make_rig()).ask(verb, 1.0) is reason


@pytest.mark.parametrize("verb", [Verb.MOVE_CP, Verb.SERVO_CP, Verb.SERVO_CV, Verb.APPROACH, Verb.INSERT, Verb.RETRACT,
                                  Verb.REGISTER_ENTRY, Verb.UNBIAS, Verb.LOAD_ARRAY])  # fmt: skip
def test_nothing_but_homing_before_homing(make_rig, verb):
    assert Bed(make_rig().enable()).ask(verb, 160.0) is Reason.NOT_HOMED


def test_what_a_homed_controller_without_array_and_plan_says(bed):
    assert bed.ask(Verb.INSERT, 5.0, 1.0) is Reason.NO_PLAN
    assert bed.ask(Verb.RETRACT, 0.0, 1.0) is Reason.NO_PLAN
    assert bed.ask(Verb.APPROACH) is Reason.NO_PLAN
    assert bed.ask(Verb.RESUME) is Reason.WRONG_STATE
    assert bed.ask(Verb.MOVE_CP, 500.0, 0.0, 0.0) is Reason.OUTSIDE_BOX
    assert bed.ask(Verb.SERVO_CV, 8.01, 0.0, 0.0) is Reason.SPEED
    assert bed.ask(Verb.LOAD_PLAN, 3.0) is Reason.STALE_SLOT
    assert bed.ask(Verb.SET_PARAMETERS, 3.0) is Reason.STALE_SLOT


def test_a_plan_without_an_array_is_not_carried_out(homed):
    assert homed.load_plan() is Reason.ACCEPTED
    assert homed.order(Verb.APPROACH) is Reason.NO_ARRAY
    assert homed.order(Verb.INSERT, 5.0, 1.0) is Reason.NO_ARRAY


def test_an_insertion_needs_the_bias_and_the_entry(homed):
    homed.do(Verb.LOAD_ARRAY)
    homed.load_plan()
    assert homed.order(Verb.INSERT, 5.0, 1.0) is Reason.NOT_UNBIASED
    homed.do(Verb.UNBIAS)
    assert homed.order(Verb.MOVE_CP, 160.0, 0.0, 0.0) is Reason.BUSY, "unbiasing needs rest"
    homed.rest()
    assert homed.order(Verb.INSERT, 5.0, 1.0) is Reason.NOT_AT_ENTRY
    assert homed.last["reason_value"] == pytest.approx(2.0, abs=1e-6)
    assert homed.last["reason_bound"] == homed.settings.trajectory.entry_tolerance_mm
    assert homed.order(Verb.RETRACT, 0.0, 1.0) is Reason.NOT_AT_ENTRY
    assert homed.order(Verb.LOAD_ARRAY) is Reason.ARRAY_LOADED
    assert homed.order(Verb.HOME) is Reason.ARRAY_LOADED


def test_what_a_moving_controller_says(moving):
    for verb in (Verb.MOVE_CP, Verb.SERVO_CP, Verb.SERVO_CV, Verb.HOME, Verb.REGISTER_ENTRY, Verb.UNBIAS,
                 Verb.LOAD_ARRAY, Verb.UNLOAD_ARRAY, Verb.APPROACH, Verb.INSERT, Verb.RETRACT):  # fmt: skip
        assert moving.ask(verb, 0.0) is Reason.BUSY, verb.name
    assert moving.ask(Verb.ENABLE) is Reason.ACCEPTED, "enabled already"
    assert moving.c.record["motion"][0] == Motion.MOVE, "and nothing has changed"


def test_what_needs_rest_is_refused_while_a_brake_is_on(moving):
    assert moving.ask(Verb.STOP) is Reason.ACCEPTED
    assert moving.c.record["motion"][0] == Motion.HOLD
    for verb in (Verb.HOME, Verb.REGISTER_ENTRY, Verb.UNBIAS, Verb.LOAD_ARRAY, Verb.UNLOAD_ARRAY):
        assert moving.ask(verb) is Reason.BUSY, verb.name
    assert moving.ask(Verb.MOVE_CP, 160.0, 0.0, 0.0) is Reason.ACCEPTED, "a move may go on from there"


def test_what_is_said_inside_the_cochlea(inserting):
    assert inserting.ask(Verb.STOP) is Reason.ACCEPTED
    for _ in range(1500):
        inserting.step()
    for verb in (Verb.MOVE_CP, Verb.SERVO_CP, Verb.SERVO_CV, Verb.APPROACH):
        assert inserting.ask(verb, 160.0, 0.0, 0.0) is not Reason.ACCEPTED
        assert inserting.c.record["command_verdict"][0] in (Reason.INSERTED, Reason.SPEED), verb.name
    assert inserting.ask(Verb.UNLOAD_ARRAY) is Reason.INSERTED
    inserting.c.memory["staged_plan"]["number"] = 2
    assert inserting.ask(Verb.LOAD_PLAN, 2.0) is Reason.BUSY
    assert inserting.ask(Verb.INSERT, 1.0, 1.0) is Reason.DEPTH
    assert inserting.ask(Verb.INSERT, 9.0, 5.0) is Reason.SPEED


def test_a_fault_says_acknowledge_not_enable(bed):
    bed.step(spoil=lambda c: c.sensors.__setitem__("amplifier_fault", 1))
    for verb in (Verb.MOVE_CP, Verb.HOME, Verb.ENABLE, Verb.INSERT, Verb.PAUSE, Verb.RESUME):
        assert bed.ask(verb, 160.0) is Reason.WRONG_STATE, verb.name
    assert bed.ask(Verb.ACKNOWLEDGE) is Reason.ACCEPTED
    assert bed.now() is Operating.DISABLED


def test_without_permission_to_arm_there_is_no_power(make_rig):
    bed = Bed(make_rig())
    bed.health = 0
    assert bed.ask(Verb.ENABLE) is Reason.NOT_REAL_TIME
    assert bed.now() is Operating.DISABLED


@pytest.mark.parametrize("verb", [-1, 20, 1000])
def test_an_unknown_verb_is_refused_with_its_number(bed, verb):
    assert bed.ask(verb) is Reason.UNKNOWN_VERB
    assert bed.c.record["reason_value"][0] == verb


def test_an_expired_command_is_refused_with_its_lateness(bed):
    assert bed.ask(Verb.MOVE_CP, 160.0, 0.0, 0.0, deadline_tick=bed.tick - 7) is Reason.EXPIRED
    assert bed.c.record["reason_value"][0] == 7
    assert bed.ask(Verb.MOVE_CP, 160.0, 0.0, 0.0, deadline_tick=bed.tick) is Reason.ACCEPTED


@pytest.mark.parametrize("verb", [Verb.STOP, Verb.DISABLE])
def test_it_is_never_too_late_to_stop(moving, verb):
    assert moving.ask(verb, math.nan, deadline_tick=0) is Reason.ACCEPTED


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    "verb", [v for v in Verb if v not in (Verb.NONE, Verb.STOP, Verb.DISABLE)], ids=lambda v: v.name
)
def test_arguments_must_be_numbers(bed, verb, bad):
    before = bed.c.memory["state"][0]["setpoint"].copy()
    assert bed.ask(verb, 160.0, bad, 0.0) is Reason.NOT_FINITE
    assert bed.c.record["reason_bound"][0] == 1, "which argument it was"
    assert np.array_equal(bed.c.memory["state"][0]["setpoint"], before)


# --- conditions ------------------------------------------------------------------------------------------------------

GATEWAY = ARMING_ALLOWED | GATEWAY_EXPECTED


@pytest.mark.parametrize(
    ("health", "condition"),
    [
        (GATEWAY, Condition.GATEWAY_LOST),
        (GATEWAY | LOG_WRITING, Condition.GATEWAY_LOST),
        (GATEWAY | ALIVE, Condition.LOG_FAILED),
        (GATEWAY | ALIVE | LOG_WRITING | OPERATOR_EXPECTED, Condition.OPERATOR_LOST),
    ],
)
def test_a_lost_partner_pauses(moving, health, condition):
    moving.health = health
    record = moving.step()
    assert condition in active(record)
    assert (record["operating_state"], record["motion"]) == (Operating.PAUSED, Motion.HOLD)
    assert record["stop_cause"] == condition
    assert moving.ask(Verb.RESUME) is Reason.STILL_PRESENT
    moving.health = ARMING_ALLOWED
    assert moving.ask(Verb.RESUME) is Reason.ACCEPTED
    assert moving.now() is Operating.ENABLED


def test_missed_ticks_pause_beyond_their_limit(moving):
    limit = int(moving.c.memory["parameters"]["overrun_ticks"][0])
    moving.missed = limit
    assert moving.step()["operating_state"] == Operating.ENABLED
    moving.missed = limit + 1
    record = moving.step()
    assert (record["operating_state"], record["condition_value"]) == (Operating.PAUSED, limit + 1)


class Stumbling:
    """A loop that misses some ticks of every window, by settings of 100 ticks, of which 10 may be missed, three times."""

    def __init__(self, bed):
        self.bed = bed
        p = bed.c.memory["parameters"][0]
        p["overrun_window_ticks"], p["overrun_window_limit"], p["overrun_windows"] = 100, 10, 3
        bed.tick += -bed.tick % 100
        bed.step()

    def window(self, *gaps):
        """One window with these gaps; the last record of it."""
        bed = self.bed
        for missed in (*gaps, *[0] * (100 - len(gaps) - sum(gaps))):
            bed.missed, bed.tick = missed, bed.tick + missed
            last = bed.step()
        return last


def test_persistent_overruns_pause_although_each_gap_is_small(moving):
    loop = Stumbling(moving)
    assert loop.window(*[1] * 10)["operating_state"] == Operating.ENABLED, "as many as may be"
    assert loop.window()["operating_state"] == Operating.ENABLED
    record = loop.window(2, 2, 2, 2, 2, 1)
    assert active(record) == {Condition.OVERRUN_PERSISTENT}
    assert (record["operating_state"], record["stop_cause"]) == (Operating.PAUSED, Condition.OVERRUN_PERSISTENT)
    moving.missed = 0
    assert moving.ask(Verb.RESUME) is Reason.STILL_PRESENT, "until a whole window has passed well"
    loop.window()
    assert moving.ask(Verb.RESUME) is Reason.ACCEPTED


def test_overruns_that_go_on_remove_power(moving):
    loop = Stumbling(moving)
    for _ in range(2):
        assert loop.window(*[1] * 11)["operating_state"] == Operating.PAUSED
    record = loop.window(*[1] * 11)
    assert record["operating_state"] == Operating.FAULT
    assert record["fault_cause"] == Condition.OVERRUN_UNABATED
    assert not record["power_request"]
    loop.window()
    moving.missed = 0
    assert moving.ask(Verb.ACKNOWLEDGE) is Reason.ACCEPTED


def test_bad_windows_apart_from_each_other_remove_no_power(moving):
    loop = Stumbling(moving)
    for _ in range(5):
        loop.window(*[1] * 11)
        record = loop.window()
    assert record["operating_state"] == Operating.PAUSED


def test_one_gap_counts_for_one_window_however_long(moving):
    loop = Stumbling(moving)
    moving.missed, moving.tick = 5000, moving.tick + 5000
    overruns = {Condition.OVERRUN, Condition.OVERRUN_PERSISTENT, Condition.OVERRUN_UNABATED}
    assert active(moving.step()) & overruns == {Condition.OVERRUN, Condition.OVERRUN_PERSISTENT}
    assert loop.bed.c.memory["state"]["overrun_missed"][0] == 100
    moving.missed = 0
    for _ in range(210):
        record = moving.step()
    assert not active(record) & overruns


def test_a_refused_device_time_is_noted_and_stops_nothing(moving):
    moving.clock_state = ClockState.REFUSED
    record = moving.step()
    assert active(record) == {Condition.DEVICE_CLOCK}
    assert record["condition_reported"] == Condition.DEVICE_CLOCK
    assert record["operating_state"] == Operating.ENABLED
    moving.clock_state = ClockState.LOCKED
    assert active(moving.step()) == set()


def test_a_motion_goes_on_from_where_it_was_after_missed_ticks(moving):
    first, second = moving.step(), moving.step()
    moving.tick, moving.missed = moving.tick + 30, 30
    third = moving.step()
    moving.missed = 0
    usual = second["pose_desired"] - first["pose_desired"]
    assert third["pose_desired"] - second["pose_desired"] == pytest.approx(usual, rel=0.05)
    assert not active(third)
    for _ in range(4000):
        last = moving.step()
    assert not last["is_busy"]
    assert last["pose_desired"] == pytest.approx([168.0, -2.0, 0.05])


def test_a_motion_asked_for_in_the_tick_that_pauses_does_not_begin(bed):
    bed.health = GATEWAY
    assert bed.ask(Verb.MOVE_CP, 165.0, 0.0, 0.0) is Reason.STILL_PRESENT
    assert bed.now() is Operating.PAUSED
    before = bed.c.record["pose_desired"][0].copy()
    for _ in range(50):
        record = bed.step()
    assert record["motion"] == Motion.HOLD
    assert np.array_equal(record["pose_desired"], before)


def test_a_short_silence_of_the_axes_is_bridged_and_a_long_one_is_a_fault(bed):
    def silence(c):
        c.sensors["axes_validity"], c.sensors["axis_angle_rad"] = INVALID, np.nan

    limit = int(bed.c.memory["parameters"]["axes_age_ticks"][0])
    for _ in range(limit):
        record = bed.step(spoil=silence)
        assert record["operating_state"] == Operating.ENABLED
        assert np.isfinite(record["command_applied_v"]).all()
    record = bed.step(spoil=silence)
    assert active(record) == {Condition.AXES_LOST}
    assert_off(bed, record)
    assert not record["is_homed"], "nobody knows how far the motors have turned since"
    assert bed.ask(Verb.ACKNOWLEDGE) is Reason.ACCEPTED
    bed.step(Verb.ENABLE)
    bed.step()
    bed.step()
    assert bed.ask(Verb.MOVE_CP, 160.0, 0.0, 0.0) is Reason.NOT_HOMED


def test_old_angles_count_as_silence(bed):
    record = bed.step(spoil=lambda c: c.sensors.__setitem__("axes_age_ticks", 6))
    assert active(record) == {Condition.AXES_LOST}


@pytest.mark.parametrize(
    ("field", "condition"), [("watchdog_tripped", Condition.WATCHDOG), ("amplifier_fault", Condition.AMPLIFIER)]
)
def test_what_the_device_reports_is_a_fault_that_latches(moving, field, condition):
    record = moving.step(spoil=lambda c: c.sensors.__setitem__(field, 1))
    assert active(record) == {condition}
    assert record["fault_cause"] == condition
    assert record["condition_reported"] == condition
    assert_off(moving, record)
    for _ in range(20):
        record = moving.step()
        assert_off(moving, record)
        assert record["condition_active"] == 0
        assert record["condition_latched"] == 1 << condition
        assert record["fault_cause"] == condition
    assert moving.ask(Verb.ACKNOWLEDGE) is Reason.ACCEPTED
    record = moving.step()
    assert (record["condition_latched"], record["fault_cause"]) == (0, -1)


@pytest.mark.parametrize(
    ("grade", "condition", "state"),
    [
        (Grade.WARNING, Condition.DEVICE_WARNING, Operating.ENABLED),
        (Grade.PAUSE, Condition.DEVICE_PAUSE, Operating.PAUSED),
        (Grade.FAULT, Condition.DEVICE_FAULT, Operating.FAULT),
    ],
)
def test_a_trouble_of_a_device_acts_by_its_grade_in_its_tick(moving, grade, condition, state):
    def trouble(c):
        c.sensors["trouble"], c.sensors["trouble_grade"] = Trouble.INDEX_DRIFT, grade
        c.sensors["trouble_device"], c.sensors["trouble_value"] = 4, 3.0

    record = moving.step(spoil=trouble)
    assert active(record) == {condition}
    assert record["operating_state"] == state
    assert (record["condition_value"], record["condition_bound"]) == (Trouble.INDEX_DRIFT, 3.0)
    assert (record["trouble"], record["trouble_device"]) == (Trouble.INDEX_DRIFT, 4)
    assert record["trouble_value"] == 3.0
    if grade is Grade.FAULT:
        assert_off(moving, record)


def test_an_acknowledgement_is_refused_while_the_cause_is_there(bed):
    def fault(c):
        c.sensors["amplifier_fault"] = 1

    bed.step(spoil=fault)
    record = bed.step(Verb.ACKNOWLEDGE, spoil=fault)
    assert record["command_verdict"] == Reason.STILL_PRESENT
    assert record["operating_state"] == Operating.FAULT


def test_power_that_does_not_come_or_goes_away_is_a_fault(bed):
    def dark(c):
        c.sensors["powered"] = 0

    bed.c.memory["state"]["power_ticks"] = 100
    limit = int(bed.c.memory["parameters"]["power_on_ticks"][0])
    for _ in range(limit - 100 + 1):
        assert bed.step(spoil=dark)["operating_state"] == Operating.ENABLED
    record = bed.step(spoil=dark)
    assert active(record) == {Condition.POWER_LOST}
    assert_off(bed, record)


def test_the_gravest_new_condition_is_the_one_reported(moving):
    moving.health = GATEWAY
    record = moving.step(spoil=lambda c: c.sensors.__setitem__("amplifier_fault", 1))
    assert active(record) == {Condition.GATEWAY_LOST, Condition.AMPLIFIER}
    assert record["condition_reported"] == Condition.AMPLIFIER
    assert moving.step()["condition_reported"] == -1, "reported once"


def test_force_beyond_the_limit_pauses_the_insertion_and_the_way_out_stays_open(inserting):
    limit = inserting.c.settings.safety.force_limit_n

    def press(c):
        c.sensors["wrench_in_sensor"][0, 2] -= 2 * limit

    for _ in range(300):
        record = inserting.step(spoil=press)
        if record["operating_state"] == Operating.PAUSED:
            break
    assert record["stop_cause"] == Condition.FORCE_LIMIT
    assert record["condition_value"] > limit == record["condition_bound"]
    for _ in range(1000):
        inserting.step(spoil=press)
    inserting.c.order(None)
    record = inserting.step(Verb.RETRACT, 0.0, 2.0, spoil=press)
    assert record["command_verdict"] == Reason.ACCEPTED
    for _ in range(1000):
        record = inserting.step(spoil=press)
    assert (record["operating_state"], record["task_state"]) == (Operating.ENABLED, Task.RETRACTING)
    assert record["depth_rate_mm_per_s"] == pytest.approx(-2.0)


@pytest.mark.parametrize("spoil", ["invalid", "old"])
def test_an_insertion_never_goes_on_blindly(inserting, spoil):
    def blind(c):
        if spoil == "old":
            c.sensors["wrench_age_ticks"] = 21
        else:
            c.sensors["wrench_validity"], c.sensors["wrench_in_sensor"] = INVALID, np.nan

    record = inserting.step(spoil=blind)
    assert record["stop_cause"] == Condition.WRENCH_LOST
    assert (record["operating_state"], record["task_state"]) == (Operating.PAUSED, Task.HOLDING)
    assert np.isfinite(record["command_applied_v"]).all()


def test_the_saturated_correction_pauses(inserting):
    def push(c):
        c.sensors["wrench_in_sensor"][0, 1] -= 0.4  # along +y of the gripper

    depths = []
    for _ in range(2000):
        record = inserting.step(spoil=push)
        depths.append(float(record["depth_mm"]))
        if record["operating_state"] == Operating.PAUSED:
            break
    assert record["stop_cause"] == Condition.ADMITTANCE_SATURATED
    depths += [float(inserting.step(spoil=push)["depth_mm"]) for _ in range(50)]
    assert np.abs(np.diff(depths, 2)).max() / 0.001**2 <= 4.0 + 1e-6, "seen late in the tick, braked without a step"
    offset = record["admittance_offset_mm"]
    assert np.linalg.norm(offset) == pytest.approx(5.0)
    assert offset[0] == pytest.approx(0.0, abs=1e-9), "nothing along the insertion axis"
    assert offset[1] > 0, "it gives way"


def test_the_cause_of_a_pause_is_the_condition_that_pauses(inserting):
    inserting.c.memory["parameters"]["stylet_stroke_mm"] = 0.1  # a NOTE is active all the while
    for _ in range(3000):
        record = inserting.step()
        if Condition.STYLET_LIMIT in active(record):
            break
    assert active(record) == {Condition.STYLET_LIMIT}
    record = inserting.step(Verb.PAUSE)
    assert record["operating_state"] == Operating.PAUSED
    assert record["stop_cause"] == -1, "somebody asked for it"


# --- numbers that are none -------------------------------------------------------------------------------------------


def finite_or_off(bed, record):
    assert np.isfinite(bed.c.actuators["command_v"]).all()
    assert np.isfinite(record["command_applied_v"]).all()
    limit = bed.c.settings.control.command_limit_v
    assert np.abs(bed.c.actuators["command_v"]).max() <= limit


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("axis", range(4))
def test_an_angle_that_is_no_number_removes_power_in_the_same_tick(moving, axis, value):
    def spoil(c):
        c.sensors["axis_angle_rad"][0, axis] = value

    record = moving.step(spoil=spoil)
    assert_off(moving, record)
    assert {Condition.NOT_FINITE, Condition.KINEMATICS, Condition.FOLLOWING_ERROR} & active(record)
    for _ in range(3):
        moving.step()
    assert moving.ask(Verb.ACKNOWLEDGE) is Reason.ACCEPTED
    assert moving.ask(Verb.ENABLE) is Reason.ACCEPTED
    for _ in range(200):
        record = moving.step()
    assert record["operating_state"] == Operating.ENABLED, "one bad sample is not remembered"
    assert np.isfinite(record["pose_measured"]).all()


@pytest.mark.parametrize("field", ["axis_angle_rad", "wrench_in_sensor"])
def test_a_force_that_is_no_number_never_reaches_an_actuator(inserting, field):
    def spoil(c):
        c.sensors[field] = np.nan

    for _ in range(30):
        finite_or_off(inserting, inserting.step(spoil=spoil))
    assert inserting.now() in (Operating.PAUSED, Operating.FAULT)


def float_fields(dtype):
    return [n for n in dtype.names if dtype[n].base.kind == "f"]


def test_no_parameter_that_is_no_number_reaches_an_actuator(entry):
    bed = Bed(entry)
    assert bed.ask(Verb.INSERT, 8.0, 2.0) is Reason.ACCEPTED
    for _ in range(500):
        bed.step()
    saved = {n: getattr(bed.c, n).copy() for n in ("memory", "sensors", "actuators")}
    device, tick = entry.lockstep.device.device.copy(), bed.tick
    for name in float_fields(bed.c.memory.dtype["parameters"]):
        for n, array in saved.items():
            getattr(bed.c, n)[:] = array
        entry.lockstep.device.device[:], bed.tick = device, tick
        bed.c.memory["parameters"][name] = np.nan
        for _ in range(60):
            finite_or_off(bed, bed.step())


def test_no_state_that_is_no_number_reaches_an_actuator(entry):
    bed = Bed(entry)
    assert bed.ask(Verb.INSERT, 8.0, 2.0) is Reason.ACCEPTED
    for _ in range(500):
        bed.step()
    saved = bed.c.memory.copy()
    for part in ("state", "profile", "plan", "robot"):
        for name in float_fields(bed.c.memory.dtype[part]):
            bed.c.memory[:] = saved
            bed.c.memory[part][name] = np.nan
            for _ in range(30):
                finite_or_off(bed, bed.step())


def test_outputs_depend_on_memory_and_inputs_alone(homed):
    """Whatever a record held before, every output is written in every tick."""
    bed, other = Bed(homed), Bed(homed.fork())
    for verb, *arguments in (
        (Verb.MOVE_CP, 165.0, 0.0, 0.0),
        (Verb.NONE,),
        (Verb.DISABLE,),
        (Verb.NONE,),
        (Verb.NONE,),
    ):
        other.c.record.view("u1")[:] = 0xA5
        for name in {*TIMING, "reserved"} & set(other.c.record.dtype.names):
            other.c.record[name] = 0
        assert bed.step(verb, *arguments).tobytes() == other.step(verb, *arguments).tobytes()


def test_every_fault_condition_is_raised_somewhere():
    """The table has no dead rows: each name occurs in the sources of the tick."""
    from pathlib import Path

    import rtctl

    folder = Path(rtctl.__file__).parent
    source = "".join(
        (folder / f"{f}.py").read_text()
        for f in ("conditions", "trajectory", "hlc", "homing", "tick", "guidance/watch", "guidance/impedance/law")
    )
    for condition, row in TABLE.items():
        assert f"Condition.{condition.name}" in source, condition.name
        assert isinstance(row.reaction, Reaction)
