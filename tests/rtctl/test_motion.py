"""The closed loop in lockstep on planar-sim: accuracy, limits, streams, and the way in and out of an insertion."""

import numpy as np
import pytest

from rtctl.commands import Reason, Verb
from rtctl.lifecycle import Condition, Motion, Operating, Task

PERIOD_S = 0.001
LENGTHS, ANGLE = slice(0, 2), 2


def limits(rig):
    t = rig.settings.trajectory
    return (
        np.array([t.speed_mm_per_s] * 2 + [t.speed_rad_per_s]),
        np.array([t.acceleration_mm_per_s2] * 2 + [t.acceleration_rad_per_s2]),
        np.array([t.jerk_mm_per_s3] * 2 + [t.jerk_rad_per_s3]),
    )


def assert_within_limits(rig, poses, slack=1.0):
    """Speed, acceleration and jerk of a sequence of poses (n, 3) by differences; a difference of a curve whose
    derivative is bounded is bounded alike."""
    speed, acceleration, jerk = limits(rig)
    for order, bound in ((1, speed), (2, acceleration), (3, jerk)):
        rate = np.diff(poses, order, axis=0) / PERIOD_S**order
        rounding = 2**order * 1e-13 / PERIOD_S**order
        assert (np.abs(rate).max(axis=0) <= slack * bound + rounding).all(), order


def in_box(rig, poses, margin=0.0):
    low, high = rig.robot.record["box_low"][0], rig.robot.record["box_high"][0]
    return ((poses >= low - margin) & (poses <= high + margin)).all()


# --- homing and moves ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", ["[154.0, -5.0, -0.01]", "[165.0, 2.0, 0.1]"])
def test_homing_finds_home_wherever_it_starts(make_rig, start):
    rig = make_rig(f"backend.options.start_pose_mm_rad={start}").home()
    assert rig.last["pose_measured"] == pytest.approx(rig.robot.home_pose, abs=1e-3)
    true = rig.truths[-1]["pose_gripper_in_base"]
    assert true[:2] == pytest.approx(rig.robot.home_pose[:2], abs=0.4), "what end stops off by 6 um make of y"
    assert rig.last["stylet_measured_mm"] == pytest.approx(0.0, abs=1e-3)
    command = rig.rows["command_applied_v"][rig.rows["motion"] == Motion.HOME]
    assert np.abs(command).max() <= rig.settings.homing.command_limit_v + 1e-9


def test_home_is_the_same_again(make_rig):
    rig = make_rig().home()
    first = rig.truths[-1]["pose_gripper_in_base"].copy()
    rig.move(165.0, 1.0, 0.05)
    rig.do(Verb.HOME)
    rig.until(lambda r: r["is_homed"] and not r["is_busy"])
    assert rig.truths[-1]["pose_gripper_in_base"] == pytest.approx(first, abs=2e-3)


@pytest.mark.parametrize("goal", [(165.0, 1.0, 0.1), (152.0, -6.0, -0.03), (172.0, 3.0, 0.22)])
def test_a_move_arrives_straight_and_within_every_limit(homed, goal):
    start = homed.last["pose_desired"].copy()
    homed.do(Verb.MOVE_CP, *goal)
    homed.rest()
    homed.run(500)
    rows = homed.rows
    assert rows[-1]["pose_desired"] == pytest.approx(goal, abs=1e-9)
    assert rows[-1]["pose_measured"] == pytest.approx(goal, abs=5e-3)
    poses = np.vstack([[start] * 4, rows["pose_desired"]])
    assert_within_limits(homed, poses)
    way = np.array(goal) - start
    share = (poses - start) @ way / (way @ way)
    assert poses == pytest.approx(start + share[:, None] * way, abs=1e-6)
    assert np.array_equal(rows["pose_reference"], rows["pose_desired"]), "no correction outside an insertion"
    assert not rows["condition_active"].any()
    true = homed.truths[-1]["pose_gripper_in_base"]
    assert true == pytest.approx(goal, abs=0.6), "the model is wrong on purpose, but not by much"
    tracking = np.abs(rows["pose_measured"] - rows["pose_desired"]).max(axis=0)
    assert tracking[0] < 0.15
    assert tracking[ANGLE] < 0.02


def test_stop_brakes_within_the_limits_and_holds(homed):
    homed.do(Verb.MOVE_CP, 172.0, -2.0, 0.1)
    homed.run(500)
    assert homed.last["is_busy"]
    homed.do(Verb.STOP)
    homed.rest()
    rows = homed.run(200)
    assert np.ptp(rows["pose_desired"], axis=0) == pytest.approx(0.0, abs=1e-12)
    assert rows[-1]["pose_desired"][0] < 171.0
    assert rows[-1]["stop_cause"] == -1
    assert_within_limits(homed, homed.rows["pose_desired"])


def test_a_motion_that_is_braked_by_a_late_condition_has_no_step_either(homed):
    """Where the setpoint leaves the workspace is seen after its step; the brake begins there, not one tick further on."""
    homed.do(Verb.MOVE_CP, 172.0, -2.0, 0.0)
    homed.controller.memory["robot"]["box_high"][0, 0] = 166.0  # a wall that was not there when the move was planned
    homed.rest()
    assert homed.last["stop_cause"] == Condition.WORKSPACE
    assert homed.rows["pose_reference"][:, 0].max() <= 166.0
    assert homed.rows["condition_value"][homed.rows["condition_reported"] == Condition.WORKSPACE][0] > 166.0
    homed.rest()
    assert_within_limits(homed, homed.rows["pose_desired"])


# --- streams ---------------------------------------------------------------------------------------------------------


def stream(rig, verb, arguments, every=10, times=30):
    for _ in range(times):
        rig.do(verb, *arguments)
        rig.run(every - 1)


def test_a_velocity_stream_reaches_its_velocity_and_ends_in_a_controlled_stop_after_50_ms(homed):
    stream(homed, Verb.SERVO_CV, (3.0, 1.0, 0.02), times=40)
    rate = np.diff(homed.rows["pose_desired"][-5:], axis=0) / PERIOD_S
    assert rate == pytest.approx(np.broadcast_to([3.0, 1.0, 0.02], (4, 3)), abs=1e-6)
    last_command = homed.rows["tick"][homed.rows["command_verb"] == Verb.SERVO_CV][-1]
    homed.rest()
    rows = homed.rows
    silent = rows[rows["motion"] == Motion.HOLD][0]
    assert silent["tick"] - last_command == 51
    assert silent["stop_cause"] == Condition.STREAM_SILENT
    assert silent["condition_value"] == 51
    assert_within_limits(homed, rows["pose_desired"])
    assert homed.last["operating_state"] == Operating.ENABLED


@pytest.mark.parametrize("direction", [(8.0, 0.0, 0.0), (-8.0, 0.0, 0.0), (0.0, 8.0, 0.0), (0.0, -8.0, 0.0),
                                       (0.0, 0.0, 0.5), (0.0, 0.0, -0.5), (8.0, 8.0, 0.5), (-8.0, 8.0, -0.5)])  # fmt: skip
def test_a_velocity_stream_into_the_edge_stops_inside(homed, direction):
    for _ in range(400):
        if homed.order(Verb.SERVO_CV, *direction) is not Reason.ACCEPTED:
            break
        homed.run(9)
        if homed.last["motion"] == Motion.HOLD:
            break
    assert homed.last["stop_cause"] == Condition.WORKSPACE
    homed.rest()
    rows = homed.rows
    assert in_box(homed, rows["pose_desired"], 1e-9)
    assert all(homed.robot.reach(p) == 0 for p in rows["pose_desired"][::7])
    assert np.array_equal(rows["pose_reference"], rows["pose_desired"]), "the brake was in time"
    assert_within_limits(homed, rows["pose_desired"])


def test_acceleration_towards_a_near_edge_is_foreseen(homed):
    """Full acceleration half a millimetre from the edge: what it still adds counts."""
    homed.move(160.0, 7.0, 0.0)
    for _ in range(100):
        homed.order(Verb.SERVO_CV, 0.0, 8.0, 0.0)
        homed.run(3)
    homed.rest()
    rows = homed.rows
    assert rows["pose_desired"][:, 1].max() > 7.0
    assert in_box(homed, rows["pose_desired"], 1e-9)
    assert np.array_equal(rows["pose_reference"], rows["pose_desired"])


def test_a_position_stream_follows_and_dies_of_silence(homed):
    t = np.arange(0.0, 2.0, 0.02)
    goals = np.array([160.0, -2.0, 0.0]) + np.column_stack((2 * np.sin(2 * t), np.sin(3 * t), 0.05 * np.sin(t)))
    for goal in goals:
        homed.do(Verb.SERVO_CP, *goal)
        homed.run(19)
    assert homed.last["pose_desired"] == pytest.approx(goals[-1], abs=0.7)
    homed.rest()
    rows = homed.rows
    assert rows[-1]["stop_cause"] == Condition.STREAM_SILENT
    assert_within_limits(homed, rows["pose_desired"], slack=1.0 + 1e-6)
    assert np.abs(rows["pose_measured"] - rows["pose_desired"])[:, 0].max() < 0.15


def test_streams_do_not_mix(homed):
    homed.do(Verb.SERVO_CV, 1.0, 0.0, 0.0)
    assert homed.order(Verb.SERVO_CP, 160.0, 0.0, 0.0) is Reason.BUSY
    assert homed.order(Verb.SERVO_CV, 0.5, 0.0, 0.0) is Reason.ACCEPTED


# --- enabling --------------------------------------------------------------------------------------------------------


def test_disabling_in_motion_takes_power_at_once_and_enabling_again_moves_nothing(homed):
    homed.do(Verb.MOVE_CP, 170.0, 0.0, 0.1)
    homed.run(700)
    speed = np.abs(np.diff(homed.rows["pose_measured"][-3:], axis=0)).max() / PERIOD_S
    assert speed > 1.0
    record = homed.do(Verb.DISABLE)
    assert record["power_request"] == 0
    assert not record["command_applied_v"].any()
    homed.run(500)
    before = homed.last["pose_measured"].copy()
    homed.enable()
    rows = homed.run(500)
    assert rows["pose_desired"] == pytest.approx(np.broadcast_to(before, (500, 3)), abs=1e-9)
    assert rows["pose_measured"] == pytest.approx(np.broadcast_to(before, (500, 3)), abs=1e-3)
    assert np.abs(rows["command_applied_v"]).max() < 0.05, "at rest already"
    assert homed.last["motion"] == Motion.HOLD, "the old move is forgotten"


def weightless(rig):
    """The module feels no jerk: what a test moves in no time is no blow, and a force is that of a touch."""
    sensor = rig.lockstep.device.device["sensor"]
    sensor["mass_kg"] = sensor["inertia_kg_mm2"] = 0.0


def test_enabling_inside_the_cochlea_moves_nothing_although_the_array_holds_the_robot_off_its_path(entry):
    weightless(entry)
    entry.do(Verb.INSERT, 6.0, 2.0)
    entry.run(2000)
    entry.do(Verb.DISABLE)
    entry.run(200)
    entry.lockstep.device.device["motor"]["angle_rad"][0, :3] += (0.0, 3.0, -2.0)  # somebody turns the screws
    entry.run(100)
    before = entry.last["pose_measured"].copy()
    depth = entry.last["depth_mm"]
    entry.enable()
    rows = entry.run(300)
    assert rows["pose_reference"] == pytest.approx(np.broadcast_to(before, (300, 3)), abs=1e-9)
    assert entry.last["task_state"] == Task.HOLDING
    assert entry.last["depth_mm"] == depth

    start = len(entry.rows)
    entry.do(Verb.RETRACT, 0.0, 2.0)
    entry.until(lambda r: r["task_state"] == Task.DONE)
    rows = entry.rows[start:]
    steps = np.abs(np.diff(np.vstack([before, rows["pose_reference"]]), axis=0))
    assert not rows["condition_active"].any()
    assert steps[:, LENGTHS].max() < 4e-3, "no jump back onto the path"
    start = entry.controller.memory["plan"]["coefficient"][0, 0, :3, 3]
    assert entry.last["pose_reference"] == pytest.approx(start, abs=0.2), "but back to it over the way"


def test_a_robot_found_outside_its_box_can_come_back(make_rig):
    rig = make_rig().home()
    rig.move(160.0, 7.9, 0.0)
    rig.controller.memory["robot"]["box_high"][0, 1] = 7.5
    rig.do(Verb.DISABLE)
    rig.run(50)
    rig.enable()
    rig.run(50)
    assert rig.order(Verb.MOVE_CP, 160.0, 7.7, 0.0) is Reason.OUTSIDE_BOX
    rig.do(Verb.MOVE_CP, 160.0, 6.0, 0.0)
    rig.rest()
    assert rig.last["pose_reference"] == pytest.approx([160.0, 6.0, 0.0], abs=1e-9)
    assert rig.last["stop_cause"] == -1


# --- insertion -------------------------------------------------------------------------------------------------------


def planned(depths):
    """Poses and stylet of the gentle path at depths (n,), independently of the tick's own evaluation."""
    d = np.asarray(depths)
    pose = np.array([160.0, 0.0, 0.0]) + np.column_stack((d, 0.02 * d**2, 0.01 * d))
    return pose, 0.8 * np.maximum(d - 2.0, 0.0)


def test_an_insertion_follows_the_plan_at_its_speed(entry):
    entry.do(Verb.INSERT, 8.0, 1.0)
    entry.until(lambda r: r["task_state"] == Task.HOLDING)
    rows = entry.run(300)
    rows = entry.rows
    pose, stylet = planned(rows["depth_mm"])
    assert rows["pose_desired"] == pytest.approx(pose, abs=1e-6)
    late = np.abs(rows["stylet_desired_mm"] - stylet)
    assert late.max() < 0.15, "shape-preserving splines round the corner of the stylet's start"
    assert rows["depth_rate_mm_per_s"].max() == pytest.approx(1.0)
    assert rows[-1]["depth_mm"] == pytest.approx(8.0)
    assert rows["pose_goal"][5:] == pytest.approx(np.broadcast_to(planned([8.0])[0], (len(rows) - 5, 3)))
    assert rows[-1]["stylet_measured_mm"] == pytest.approx(rows[-1]["stylet_reference_mm"], abs=0.02)
    depth = rows["depth_mm"]
    a, j = entry.settings.trajectory.depth_acceleration_mm_per_s2, entry.settings.trajectory.depth_jerk_mm_per_s3
    assert np.abs(np.diff(depth, 2)).max() / PERIOD_S**2 <= a + 1e-6
    assert np.abs(np.diff(depth, 3)).max() / PERIOD_S**3 <= j + 1e-3


def test_pause_and_resume_keep_path_and_goal(entry):
    entry.do(Verb.INSERT, 6.0, 2.0)
    entry.run(1500)
    entry.do(Verb.PAUSE)
    entry.rest()
    paused = entry.run(1000)
    assert np.ptp(paused["depth_mm"]) == 0.0
    assert (paused["operating_state"] == Operating.PAUSED).all()
    depth = paused[-1]["depth_mm"]
    assert entry.order(Verb.INSERT, 6.0, 2.0) is Reason.WRONG_STATE
    entry.do(Verb.RESUME)
    assert entry.last["depth_mm"] == pytest.approx(depth, abs=1e-3)
    entry.until(lambda r: r["task_state"] == Task.HOLDING)
    rows = entry.rows
    assert rows[-1]["depth_mm"] == pytest.approx(6.0)
    assert rows["pose_desired"] == pytest.approx(planned(rows["depth_mm"])[0], abs=1e-6)
    assert np.abs(np.diff(rows["depth_mm"], 2)).max() / PERIOD_S**2 <= 4.0 + 1e-6


def test_resuming_while_the_brake_is_still_on_has_no_step(entry):
    entry.do(Verb.INSERT, 6.0, 2.0)
    entry.run(1500)
    entry.do(Verb.PAUSE)
    entry.run(100)
    assert entry.last["depth_rate_mm_per_s"] > 0.5
    entry.do(Verb.RESUME)
    entry.until(lambda r: r["task_state"] == Task.HOLDING)
    assert np.abs(np.diff(entry.rows["depth_mm"], 2)).max() / PERIOD_S**2 <= 4.0 + 1e-6
    assert entry.last["depth_mm"] == pytest.approx(6.0)


def test_a_retraction_goes_back_along_the_same_path_and_leaves_the_stylet_out(entry):
    entry.do(Verb.INSERT, 6.0, 2.0)
    entry.until(lambda r: r["task_state"] == Task.HOLDING)
    out = entry.last["stylet_reference_mm"]
    assert out > 3.0
    entry.do(Verb.RETRACT, 2.0, 2.0)
    entry.until(lambda r: r["task_state"] == Task.HOLDING)
    assert entry.last["depth_mm"] == pytest.approx(2.0)
    entry.do(Verb.RETRACT, 0.0, 2.0)
    entry.until(lambda r: r["task_state"] == Task.DONE)
    rows = entry.rows
    assert rows["pose_desired"] == pytest.approx(planned(rows["depth_mm"])[0], abs=1e-6)
    assert (np.diff(rows["stylet_reference_mm"]) >= 0).all(), "a stylet never goes back in"
    assert rows[-1]["stylet_reference_mm"] == pytest.approx(out, abs=0.05)


def test_out_of_a_pause_one_may_retract(entry):
    entry.do(Verb.INSERT, 6.0, 2.0)
    entry.run(2000)
    entry.do(Verb.PAUSE)
    entry.do(Verb.RETRACT, 0.0, 2.0)
    entry.until(lambda r: r["task_state"] == Task.DONE)
    assert entry.last["operating_state"] == Operating.ENABLED
    assert np.abs(np.diff(entry.rows["depth_mm"], 2)).max() / PERIOD_S**2 <= 4.0 + 1e-6


def test_stop_holds_and_a_second_stop_ends_the_insertion(entry):
    entry.do(Verb.INSERT, 6.0, 2.0)
    entry.run(2000)
    entry.do(Verb.STOP)
    assert entry.rest()["task_state"] == Task.HOLDING
    assert entry.order(Verb.MOVE_CP, 160.0, 0.0, 0.0) is Reason.INSERTED
    entry.do(Verb.STOP)
    assert entry.last["task_state"] == Task.DONE
    entry.do(Verb.MOVE_CP, 158.0, 0.0, 0.0)
    entry.rest()
    assert entry.last["depth_mm"] == 0.0


def test_a_new_plan_after_an_insertion_begins_at_its_own_entry_again(entry):
    """The depth of the old insertion must not survive into the new one."""
    entry.do(Verb.INSERT, 6.0, 2.0)
    entry.until(lambda r: r["task_state"] == Task.HOLDING)
    entry.do(Verb.STOP)
    plan = entry.controller.memory["plan"].copy()
    plan["number"] = 2
    assert entry.load_plan(plan) is Reason.ACCEPTED
    entry.run(10)
    assert entry.last["depth_mm"] == 0.0
    entry.do(Verb.APPROACH)
    entry.until(lambda r: r["task_state"] == Task.AT_ENTRY)
    before = entry.last["pose_reference"].copy()
    entry.do(Verb.INSERT, 5.0, 1.0)
    entry.run(200)
    assert entry.last["depth_mm"] < 0.2
    assert entry.last["pose_reference"] == pytest.approx(before, abs=0.2)


def test_after_a_full_retraction_one_may_approach_and_insert_again(entry):
    for _ in range(2):
        entry.do(Verb.INSERT, 4.0, 2.0)
        entry.until(lambda r: r["task_state"] == Task.HOLDING)
        entry.do(Verb.RETRACT, 0.0, 2.0)
        entry.until(lambda r: r["task_state"] == Task.DONE)
        assert entry.order(Verb.INSERT, 4.0, 2.0) is Reason.NOT_AT_ENTRY
        entry.do(Verb.APPROACH)
        entry.until(lambda r: r["task_state"] == Task.AT_ENTRY)


def test_an_insertion_does_not_begin_away_from_the_entry(entry):
    entry.do(Verb.DISABLE)
    entry.run(100)
    entry.lockstep.device.device["motor"]["angle_rad"][0, :3] += 15.0  # somebody turns the screws
    entry.run(50)
    entry.enable()
    assert entry.order(Verb.INSERT, 4.0, 1.0) is Reason.NOT_AT_ENTRY
    assert entry.last["reason_value"] > entry.settings.trajectory.entry_tolerance_mm == entry.last["reason_bound"]


@pytest.mark.parametrize(
    "leave", [Verb.MOVE_CP, Verb.SERVO_CV, Verb.LOAD_PLAN, Verb.UNLOAD_ARRAY], ids=lambda v: v.name
)
def test_the_lateral_correction_is_no_step_where_the_path_is_left(entry, leave):
    weightless(entry)
    entry.do(Verb.INSERT, 4.0, 2.0)
    entry.until(lambda r: r["task_state"] == Task.HOLDING)
    entry.state["lateral_offset_mm"][:2] = (0.0, 1.5)
    entry.run(600)
    assert entry.last["pose_reference"][1] - entry.last["pose_desired"][1] == pytest.approx(1.5, abs=1e-6)
    entry.do(Verb.STOP)
    entry.run(100)
    before = entry.last["pose_reference"].copy()
    if leave is Verb.LOAD_PLAN:
        assert entry.load_plan() is Reason.ACCEPTED
    else:
        entry.do(leave, *((160.0, -1.0, 0.0) if leave is Verb.MOVE_CP else (0.5, 0.0, 0.0)))
    for name in ("pose_reference", "pose_desired"):
        assert entry.last[name] == pytest.approx(before, abs=1e-5)
    assert not entry.last["admittance_offset_mm"].any()
    assert entry.last["depth_mm"] == 0.0
    start = len(entry.rows)
    entry.rest()
    assert entry.last["pose_reference"] == pytest.approx(entry.last["pose_desired"], abs=1e-9)
    steps = np.abs(np.diff(entry.rows["pose_reference"][start - 1 :, LENGTHS], axis=0))
    assert steps.max(initial=0.0) <= 8e-3 + 1e-9


def test_changed_filter_coefficients_are_no_jolt(entry):
    entry.do(Verb.INSERT, 8.0, 1.0)
    entry.run(1000)
    force = entry.rows["wrench_in_base"][-200:, :3].mean(axis=0)
    memory = entry.controller.memory
    memory["staged_parameters"] = memory["parameters"]
    staged = memory["staged_parameters"][0]
    from rtctl.parameters import butterworth_low_pass

    staged["filter_b"], staged["filter_a"] = butterworth_low_pass(40.0, PERIOD_S)
    staged["number"] = 2
    entry.do(Verb.SET_PARAMETERS, 2.0)
    rows = entry.run(300)
    assert rows["parameter_set"][0] == 2
    assert np.abs(rows["wrench_in_base"][:, :3] - force).max() < 0.03


# --- determinism -----------------------------------------------------------------------------------------------------


def script(rig):
    rig.home()
    rig.move(160.0, -2.0, 0.0)
    rig.do(Verb.LOAD_ARRAY)
    rig.do(Verb.UNBIAS)
    rig.rest()
    return rig.rows, rig.truths


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(make_rig):
    (rows, truths), (again, truths_again), (other, _) = (script(make_rig(seed=s)) for s in (4, 4, 5))
    assert rows.tobytes() == again.tobytes()
    assert truths.tobytes() == truths_again.tobytes()
    n = min(len(rows), len(other))
    assert rows[:n].tobytes() != other[:n].tobytes()


def test_how_time_is_cut_into_blocks_does_not_matter(homed_rig):
    one, two = homed_rig.fork(), homed_rig.fork()
    for rig in (one, two):
        rig.do(Verb.MOVE_CP, 165.0, 1.0, 0.05)
    a = one.run(1800)
    b = np.concatenate([two.run(n) for n in (1, 7, 992, 500, 300)])
    assert a.tobytes() == b.tobytes()
