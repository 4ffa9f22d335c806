"""The bench as a whole: homing, rest, memory of sessions, time, injected failures, determinism."""

import math

import numba
import numpy as np
import pytest

from hal.errors import OptionError
from hal.frames import INVALID, SATURATED, VALID
from hal.kernel import kernel
from sim_backends.plant import device
from sim_backends.plant.backend import PlantBackend
from sim_backends.plant.options import PlantOptions

HOME_ERROR_MM = (0.006, -0.004, 0.003)


@pytest.mark.parametrize("command_v", [-0.6, -1.0, -1.5])
def test_homing_stalls_every_motor_at_its_stop_wherever_it_started_and_however_hard_it_pushes(drive, command_v):
    for start in ([154.0, -5.0, -0.01], [158.0, 0.0, 0.05]):
        bench = drive({"start_pose_mm_rad": start})
        bench.run(9000, command_v)
        stopped = bench.sensors["axis_angle_rad"].copy()
        assert not bench.truth["motor_rate_rad_per_s"].any()
        assert bench.device["leg"]["piston_mm"] == pytest.approx(HOME_ERROR_MM, abs=2e-4)
        assert bench.truth["stylet_rod_mm"] == 0.0
        bench.run(300, command_v)
        assert np.array_equal(bench.sensors["axis_angle_rad"], stopped)


def test_home_is_found_again_to_an_encoder_count(drive):
    bench = drive()
    bench.run(9000, -1.0)
    first = bench.sensors["axis_angle_rad"].copy()
    bench.run(1500, 2.0)
    assert (bench.sensors["axis_angle_rad"] > first + 20).all()
    bench.run(9000, -1.0)
    assert bench.sensors["axis_angle_rad"] == pytest.approx(first, abs=2 * math.pi / 4096)


def test_ten_volts_are_several_times_what_one_volt_gives(drive):
    speeds = []
    for command in (1.0, 10.0):
        bench = drive()
        bench.run(60, command)
        speeds.append(bench.truth["motor_rate_rad_per_s"].min())
    assert speeds[0] > 10
    assert speeds[1] > 200


def test_a_bench_at_rest_stays_where_it_is(drive):
    bench = drive()
    pose = bench.truth["pose_gripper_in_base"].copy()
    bench.run(3000, 0.0)
    assert not bench.sensors["axis_angle_rad"].any()
    assert bench.truth["pose_gripper_in_base"] == pytest.approx(pose, abs=1e-12)
    assert pose == pytest.approx(PlantOptions.start_pose_mm_rad, abs=1e-9)


def test_the_wires_are_at_their_pretension_before_anything_moves(drive):
    bench = drive()
    bench.run(1)
    assert bench.truth["wire_tension_n"] == pytest.approx([15.0] * 6, abs=1e-9)


def test_encoders_start_at_zero_in_every_session_and_the_mechanics_persist(drive):
    bench = drive()
    bench.run(500, 2.0)
    pose = bench.truth["pose_gripper_in_base"].copy()
    bench.run(200, 0.0, power=0)
    rested = bench.truth["pose_gripper_in_base"].copy()
    assert abs(rested - pose)[0] < 3
    bench.backend.close()
    bench.backend.open()
    assert not bench.read(bench.tick + 1)["axis_angle_rad"].any()
    assert bench.truth["pose_gripper_in_base"] == pytest.approx(rested, abs=1e-12)


def test_the_stylet_is_pulled_and_never_pushed_back(drive):
    bench = drive({"stylet": {"start_mm": 0.0}})
    bench.load_array()
    bench.run(400, (0.0, 0.0, 0.0, 3.0))
    pulled = float(bench.truth["stylet_mm"])
    assert pulled > 1.0
    bench.run(600, (0.0, 0.0, 0.0, -3.0))
    assert bench.truth["stylet_rod_mm"] < pulled - 0.5
    assert pulled <= bench.truth["stylet_mm"] < pulled + 0.3  # the rod overruns a little before it turns round
    bench.run(5000, (0.0, 0.0, 0.0, 5.0))
    assert bench.truth["stylet_rod_mm"] == 16.0
    assert bench.truth["stylet_mm"] == 15.0
    bench.load_array(0)
    bench.run(2000, (0.0, 0.0, 0.0, -5.0))
    bench.load_array(1)
    bench.run(1, 0.0)
    assert bench.truth["stylet_mm"] == bench.truth["stylet_rod_mm"]


def test_the_array_appears_when_it_is_loaded_and_goes_when_it_is_taken_out(drive):
    bench = drive()
    assert np.isnan(bench.truth["array_tip_in_base_mm"]).all()
    bench.load_array()
    bench.run(1)
    nodes = bench.truth["array_node_in_base_mm"].reshape(-1, 2)
    assert nodes[0] == pytest.approx(bench.truth["pose_gripper_in_base"][:2])
    assert np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum() == pytest.approx(18.0, abs=0.05)  # chords
    assert bench.truth["array_tip_in_base_mm"] == pytest.approx(nodes[-1])
    bench.load_array(0)
    bench.run(1)
    assert np.isnan(bench.truth["array_node_in_base_mm"]).all()


def test_missed_ticks_are_simulated_as_if_they_had_been_read(drive):
    every, jump = drive(), drive()
    for bench in (every, jump):
        bench.run(100, 3.0)
    for _ in range(40):
        every.read(every.tick + 1)
    jump.read(jump.tick + 40)
    for name in every.sensors.dtype.names:
        if not name.endswith("sequence"):
            assert np.array_equal(every.sensors[name], jump.sensors[name], equal_nan=True), name
    assert np.array_equal(every.truth["pose_gripper_in_base"], jump.truth["pose_gripper_in_base"])


def test_a_long_silence_ends_without_power_and_at_rest(drive):
    near, far = drive(), drive()
    for bench, ticks in ((near, 3000), (far, 10**9)):
        bench.run(300, 5.0)
        frame = bench.read(bench.tick + ticks)
        assert (frame["powered"], frame["watchdog_tripped"]) == (0, 1)
        assert not bench.truth["motor_rate_rad_per_s"].any()
    assert np.array_equal(near.sensors["axis_angle_rad"], far.sensors["axis_angle_rad"])
    assert near.truth["pose_gripper_in_base"] == pytest.approx(far.truth["pose_gripper_in_base"], abs=1e-9)


def test_a_command_that_is_not_finite_stops_the_push_at_once(drive):
    bench = drive()
    bench.run(100, 5.0)
    bench.run(1, math.nan)
    assert not bench.truth["motor_current_a"].any()
    assert bench.sensors["powered"][0]


def test_commands_are_clipped_to_what_an_amplifier_takes(drive):
    bench = drive()
    bench.run(2, 1000.0)
    assert bench.truth["motor_current_a"] == pytest.approx([2.0] * 4)


def bytes_of(drive, table, seed):
    bench = drive(table, seed)
    bench.load_array()
    return b"".join(bench.run(1, 2.0).tobytes() for _ in range(300)), bench.truth.tobytes()


def test_the_same_seed_gives_the_same_bytes_and_another_one_does_not(drive):
    one, again, other = (bytes_of(drive, {}, seed) for seed in (3, 3, 4))
    assert one == again
    assert one[0] != other[0]
    assert one[1] == other[1]  # noise is in the sensor, not in the mechanics


INJECTIONS = {
    "axes_silent": lambda f: f["axes_validity"] == INVALID and np.isnan(f["axis_angle_rad"]).all(),
    "wrench_silent": lambda f: f["wrench_validity"] == INVALID and np.isnan(f["wrench_in_sensor"]).all(),
    "wrench_saturated": lambda f: f["wrench_validity"] == SATURATED,
    "amplifier_fault": lambda f: f["amplifier_fault"] == 1 and f["powered"] == 0,
}


@pytest.mark.parametrize("name", INJECTIONS)
def test_failures_come_when_they_are_ordered(drive, name):
    bench = drive({"inject": {f"{name}_after_s": 0.1}})
    before = bench.run(99).copy()
    assert not INJECTIONS[name](before)
    assert (before["axes_validity"], before["wrench_validity"], before["powered"]) == (VALID, VALID, 1)
    after = bench.run(1)
    assert INJECTIONS[name](after)
    healthy = [n for n in ("axes", "wrench") if not name.startswith(n)]
    assert all(after[f"{n}_validity"] == VALID for n in healthy)


def test_a_silent_group_ages_and_stops_counting(drive):
    bench = drive({"inject": {"axes_silent_after_s": 0.01}})
    bench.run(30)
    assert bench.sensors["axes_age_ticks"][0] == 30 - 9
    assert bench.sensors["axes_sequence"][0] == 10
    assert bench.sensors["wrench_age_ticks"][0] == 0


def test_a_jammed_motor_stands_while_the_others_turn(drive):
    bench = drive({"inject": {"jam_after_s": 0.05, "jam_axis": 2}})
    bench.run(49, 3.0)
    assert (bench.truth["motor_rate_rad_per_s"] > 10).all()
    bench.run(1, 3.0)
    stuck = bench.sensors["axis_angle_rad"][0, 2]
    bench.run(100, 3.0)
    assert bench.sensors["axis_angle_rad"][0, 2] == stuck
    assert (np.delete(bench.truth["motor_rate_rad_per_s"], 2) > 10).all()


def test_settings_are_checked():
    with pytest.raises(OptionError, match=r"backend\.options\.wire\.backlash_rad"):
        PlantBackend({"wire": {"backlash_rad": [1.0]}}, period_s=0.001, seed=0)
    with pytest.raises(OptionError, match="did you mean 'sensor'"):
        PlantBackend({"sensr": {}}, period_s=0.001, seed=0)


def test_the_kernels_are_functions_a_compiled_loop_can_be_given(drive):
    function = numba.types.FunctionType
    one, two = drive(), drive()
    d = two.backend.compiled()
    signature = numba.void(
        function(device.READ),
        function(device.WRITE),
        *(numba.typeof(a) for a in (d.device, two.sensors, two.actuators)),
        numba.int64,
    )

    @kernel(signature=signature)
    def loop(read, write, bench, sensors, actuators, ticks):
        for tick in range(ticks):
            write(bench[0], tick, actuators[0])
            read(bench[0], tick + 1, sensors[0])

    two.actuators["power"], two.actuators["command_v"] = 1, 2.0
    loop(d.read, d.write, d.device, two.sensors, two.actuators, 200)
    one.run(200, 2.0)
    assert one.sensors.tobytes() == two.sensors.tobytes()
    assert one.truth.tobytes() == two.truth.tobytes()


def test_robot_and_array_in_contact_come_to_rest(drive):
    """The soft lateral direction of the robot against the stiffest array there may be: no oscillation."""
    stiff = {
        "bending_tip_nmm2": 0.3,
        "bending_base_nmm2": 2.0,
        "stylet_bending_nmm2": 8.0,
        "curvature_base_per_mm": 0.0,
    }
    table = {"array": stiff, "wire": {"backlash_rad": [0.0] * 3}, "stylet": {"start_mm": 0.0}}
    bench = drive({**table, "start_pose_mm_rad": [154.7, 1.8, 0.06]})
    bench.load_array()
    forces = []
    for _ in range(1500):
        bench.run(1, (1.2, 1.2, 1.2, 0.0))
        forces.append(bench.truth["wrench_on_gripper_in_base"].copy())
    assert bench.truth["inside"]
    assert bench.truth["array_depth_mm"] > 3
    moving = np.array(forces)[:, 1]
    assert np.abs(moving).max() > 0.02
    assert np.sqrt(np.mean(np.diff(moving, n=2) ** 2)) < 0.002
    for _ in range(1500):
        bench.run(1, 0.0)
        forces.append(bench.truth["wrench_on_gripper_in_base"].copy())
    creep = np.diff(forces[-50:], axis=0)[:, 1]  # what rests still creeps, by less than 0.02 mm/s, and one way only
    assert np.abs(creep).max() < 1e-4
    assert (creep <= 1e-9).all() or (creep >= -1e-9).all()
