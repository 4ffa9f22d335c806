"""What happens when the plant fails to order, and when the loop itself does."""

import numpy as np
import pytest

from rtctl.commands import Reason, Verb
from rtctl.lifecycle import Condition, Motion, Operating, Task

AFTER_S = 12.0
AFTER = 12_000
INJECT = "backend.options.inject."


def injected(make_rig, name, *more):
    return make_rig(f"{INJECT}{name}_after_s={AFTER_S}", *more)


def run_until_injection(rig, extra=100):
    rig.run(AFTER - rig.lockstep.tick + extra)
    return rig.rows


def first(rows, condition):
    """The first row in which a condition holds."""
    return rows[np.flatnonzero(rows["condition_active"] >> condition & 1)[0]]


def assert_power_is_gone_with(rows, condition):
    row = first(rows, condition)
    assert row["operating_state"] == Operating.FAULT
    assert row["power_request"] == 0
    assert not row["command_applied_v"].any()
    after = rows[rows["tick"] >= row["tick"]]
    assert (after["operating_state"] == Operating.FAULT).all()
    assert not after["command_applied_v"].any()
    assert not after["powered"][2:].any()
    assert (after["fault_cause"] == condition).all()
    return row


def busy_move(rig):
    rig.home()
    rig.move(152.0, -6.0, 0.0)
    rig.run(AFTER - rig.lockstep.tick - 500)
    rig.do(Verb.MOVE_CP, 172.0, 2.0, 0.1)


def test_a_jam_is_a_following_error_and_removes_power(make_rig):
    rig = injected(make_rig, "jam", INJECT + "jam_axis=1")
    busy_move(rig)
    row = assert_power_is_gone_with(run_until_injection(rig, 1500), Condition.FOLLOWING_ERROR)
    assert row["condition_value"] > rig.settings.safety.following_error_rad == row["condition_bound"]
    assert AFTER < row["tick"] < AFTER + 1000
    assert rig.order(Verb.ENABLE) is Reason.WRONG_STATE
    rig.do(Verb.ACKNOWLEDGE)
    before = rig.last["pose_measured"].copy()
    rig.enable()
    rows = rig.run(200)
    assert (rows["operating_state"] == Operating.ENABLED).all(), "bumpless: nothing pulls at the jam"
    assert rows["pose_desired"] == pytest.approx(np.broadcast_to(before, (200, 3)), abs=1e-9)


def test_silent_encoders_remove_power_after_their_age_limit_and_cost_the_home(make_rig):
    rig = injected(make_rig, "axes_silent")
    busy_move(rig)
    row = assert_power_is_gone_with(run_until_injection(rig), Condition.AXES_LOST)
    assert row["tick"] - AFTER == rig.settings.safety.axes_age_ticks
    assert not row["is_homed"]
    assert rig.order(Verb.ACKNOWLEDGE) is Reason.STILL_PRESENT


def test_an_amplifier_fault_removes_power_and_stays_until_it_is_repaired(make_rig):
    rig = injected(make_rig, "amplifier_fault")
    busy_move(rig)
    row = assert_power_is_gone_with(run_until_injection(rig), Condition.AMPLIFIER)
    assert row["tick"] == AFTER
    assert rig.order(Verb.ACKNOWLEDGE) is Reason.STILL_PRESENT
    rig.lockstep.device.device["amplifier_fault_ticks"] = 2**62
    rig.lockstep.device.device["amplifier_fault"] = 0
    rig.run(5)
    rig.do(Verb.ACKNOWLEDGE)
    rig.enable()
    rig.move(160.0, 0.0, 0.0)
    assert rig.last["operating_state"] == Operating.ENABLED


@pytest.mark.parametrize("name", ["wrench_silent", "wrench_saturated"])
def test_a_lost_force_pauses_the_insertion_and_lets_it_out(make_rig, name):
    rig = injected(make_rig, name).at_entry()
    rig.run(AFTER - rig.lockstep.tick - 2000)
    rig.do(Verb.INSERT, 8.0, 1.0)
    rows = run_until_injection(rig, 2000)
    row = first(rows, Condition.WRENCH_LOST)
    assert row["tick"] == AFTER
    assert (row["operating_state"], row["task_state"]) == (Operating.PAUSED, Task.HOLDING)
    assert rig.last["depth_rate_mm_per_s"] == 0.0
    assert rig.last["power_request"] == 1, "a pause keeps the robot where it is"
    assert rig.order(Verb.RESUME) is Reason.ACCEPTED
    rig.run(2)
    assert rig.last["operating_state"] == Operating.PAUSED, "the force is still not known"
    rig.do(Verb.RETRACT, 0.0, 2.0)
    rig.until(lambda r: r["task_state"] == Task.DONE)
    assert rig.last["operating_state"] == Operating.ENABLED


def test_a_sensor_that_drifts_before_the_insertion_is_told_and_unbiasing_mends_it(make_rig):
    rate_n_per_s, limit_n = 0.02, 0.04
    drift = f"backend.options.sensor.drift_per_min=[0, 0, {60 * rate_n_per_s}, 0, 0, 0]"
    rig = make_rig(drift, f"safety.drift_limit_n={limit_n}").at_entry()
    rig.do(Verb.UNBIAS)
    rig.until(lambda r: not r["is_busy"])
    begin = rig.lockstep.tick
    rig.run(5000)
    rows = rig.rows[rig.rows["tick"] >= begin]
    row = first(rows, Condition.FORCE_DRIFT)
    expected = begin + 1000 * (limit_n / rate_n_per_s + rig.settings.safety.drift_s)
    assert row["tick"] == pytest.approx(expected, abs=400), "its zero is the mean of half a second"
    assert (rows["operating_state"] == Operating.ENABLED).all()
    rig.do(Verb.UNBIAS)
    rig.until(lambda r: not r["is_busy"])
    assert not rig.run(1000)["condition_active"].any()


def test_no_sensor_is_unbiased_inside_the_cochlea(make_rig):
    rig = make_rig().at_entry()
    rig.do(Verb.INSERT, 2.0, 1.0)
    rig.rest()
    assert rig.order(Verb.UNBIAS) is Reason.INSERTED
    assert rig.last["is_unbiased"]


def test_power_is_refused_while_a_motor_has_told_no_angle(make_rig):
    rig = make_rig(f"{INJECT}axes_silent_after_s=0.0")
    assert rig.order(Verb.ENABLE) is Reason.AXES_UNKNOWN
    assert rig.last["operating_state"] == Operating.DISABLED
    assert not rig.last["power_request"]
    rows = rig.run(50)
    assert not rows["condition_active"].any(), "what was never known is not lost: drives on a bus take time to answer"
    assert rig.order(Verb.ENABLE) is Reason.AXES_UNKNOWN


def test_a_lost_force_does_not_disturb_a_move_without_an_array(make_rig):
    rig = injected(make_rig, "wrench_silent")
    busy_move(rig)
    run_until_injection(rig)
    rig.rest()
    assert rig.last["pose_desired"] == pytest.approx([172.0, 2.0, 0.1], abs=1e-9)


def test_a_loop_that_was_silent_finds_the_device_s_watchdog_tripped(homed):
    homed.do(Verb.MOVE_CP, 172.0, 0.0, 0.0)
    homed.run(500)
    homed.lockstep.tick += homed.lockstep.backend.watchdog_ticks + 10
    row = homed.run(1)[0]
    assert row["watchdog_tripped"]
    assert row["fault_cause"] == Condition.WATCHDOG
    assert (row["power_request"], row["operating_state"]) == (0, Operating.FAULT)
    rows = homed.run(50)
    assert not rows[5:]["watchdog_tripped"].any(), "a write without power re-arms it"
    assert (rows["operating_state"] == Operating.FAULT).all(), "the fault stays"
    homed.do(Verb.ACKNOWLEDGE)
    homed.enable()
    homed.move(165.0, 0.0, 0.0)


def test_a_shorter_silence_is_survived_without_a_jump(homed):
    homed.do(Verb.MOVE_CP, 172.0, 0.0, 0.0)
    homed.run(500)
    before = homed.last["pose_reference"].copy()
    homed.lockstep.tick += 20
    rows = homed.run(100)
    assert not rows["watchdog_tripped"].any()
    step = np.linalg.norm(np.diff(np.vstack([before, rows["pose_reference"]])[:, :2], axis=0), axis=1)
    assert step.max() <= 1.5 * 8.0 * 0.001 + 1e-12
    homed.rest()
    assert homed.last["pose_reference"] == pytest.approx([172.0, 0.0, 0.0], abs=1e-9)


def test_homing_that_finds_no_stop_fails_and_says_so(make_rig):
    rig = make_rig("homing.timeout_s=1.5").enable()
    rig.do(Verb.HOME)
    rig.run(1600)
    assert (rig.last["motion"], rig.last["is_homed"]) == (Motion.HOLD, 0)
    assert rig.last["stop_cause"] == Condition.HOMING_FAILED
    row = first(rig.rows, Condition.HOMING_FAILED)
    assert row["condition_bound"] == 1500
    assert not rig.last["is_busy"]
    rows = rig.run(500)
    assert np.abs(rows["command_applied_v"][100:]).max() < 0.2, "it does not push on"


def test_a_stop_during_homing_leaves_the_motors_where_they_are(make_rig):
    rig = make_rig().enable()
    rig.do(Verb.HOME)
    rig.run(800)
    rig.do(Verb.STOP)
    rows = rig.run(1500)
    assert rows[-1]["motion"] == Motion.HOLD
    assert np.ptp(rows["axis_angle_rad"][300:], axis=0).max() < 0.05
    assert rig.order(Verb.MOVE_CP, 160.0, 0.0, 0.0) is Reason.NOT_HOMED
    rig.do(Verb.HOME)
    rig.until(lambda r: r["is_homed"])


def test_after_a_fault_the_insertion_can_still_be_retracted(make_rig):
    rig = make_rig().at_entry()
    rig.do(Verb.INSERT, 8.0, 2.0)
    rig.run(3000)
    rig.lockstep.tick += 100
    rig.run(10)
    assert rig.last["operating_state"] == Operating.FAULT
    rig.do(Verb.ACKNOWLEDGE)
    rig.enable()
    rig.run(100)
    assert rig.last["task_state"] == Task.HOLDING
    rig.do(Verb.RETRACT, 0.0, 2.0)
    rig.until(lambda r: r["task_state"] == Task.DONE)


def test_lost_encoders_inside_leave_a_way_to_home_for_the_surgeon(make_rig):
    rig = make_rig().at_entry()
    rig.do(Verb.INSERT, 8.0, 2.0)
    rig.run(3000)
    device = rig.lockstep.device.device
    device["axes_silent_ticks"] = rig.lockstep.tick
    rig.run(50)
    assert rig.last["fault_cause"] == Condition.AXES_LOST
    device["axes_silent_ticks"] = 2**62
    rig.run(5)
    rig.do(Verb.ACKNOWLEDGE)
    assert rig.order(Verb.UNLOAD_ARRAY) is Reason.INSERTED
    rig.do(Verb.STOP)
    rig.do(Verb.UNLOAD_ARRAY)
    rig.enable()
    rig.do(Verb.HOME)
    rig.until(lambda r: r["is_homed"] and not r["is_busy"])
    assert rig.last["depth_mm"] == 0.0


def test_homing_with_soft_gains_does_not_mistake_its_own_lead_for_a_jam(make_rig):
    rig = make_rig("control.proportional_v_per_rad=[0.3, 0.3, 0.3, 0.3]", "safety.following_error_rad=4.0").home()
    assert rig.last["operating_state"] == Operating.ENABLED
