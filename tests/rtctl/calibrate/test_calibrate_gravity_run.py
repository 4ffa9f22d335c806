"""The routine that turns the robot: what it finds on the plant against the plant's truth, and what it refuses."""

import numpy as np
import pytest

from hal.kernel import kernel
from rtctl import robots, wrench
from rtctl.calibrate import gravity_run
from rtctl.calibrate.errors import CalibrationError
from rtctl.calibrate.gravity_run import Gravity, Readings, check_ready, fit, poses_about, require, turn_into_sensor
from rtctl.calibrate.simulated import SimulatedRobot
from rtctl.commands import Verb
from rtctl.settings import load
from rtctl.workflow import WorkflowError

WEIGHT_N, CENTRE_MM, BIAS = 1.5, np.array([3.0, -2.0, 25.0]), np.array([0.35, -0.20, 0.80])
BELIEF = "wrench.gravity_force_in_base_n=[0.0, 0.0, 0.0]"


def direction(*vector):
    return WEIGHT_N * np.array(vector) / np.linalg.norm(vector)


def in_the_middle(*overrides, seed=0):
    settings = load("planar-sim", [BELIEF, *overrides])
    simulated = SimulatedRobot(settings, seed)
    simulated.script(("middle",)).move("middle", simulated.middle(), settings)
    return simulated


def readings_of(simulated, count=8, samples=20) -> Readings:
    return gravity_run.run(simulated.operator, simulated.settings, count, samples=samples)


def test_the_rotation_is_the_one_the_tick_uses():
    settings = load("planar-sim")
    robot = robots.load(settings.robot.kind, settings.robot.geometry)
    pose, force, turned = np.array([160.0, -2.0, 0.3]), np.array([0.1, -0.4, 1.3]), np.empty(3)
    _into_sensor(robot.rotation(pose), force, turned)
    assert turn_into_sensor(robot, pose) @ force == pytest.approx(turned, abs=1e-15)


@kernel
def _into_sensor(rotation, force, result):
    wrench.into_sensor(rotation, force, result)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_true_weight_of_the_plant_comes_out_as_far_as_a_planar_robot_can_tell(seed):
    """The sensor's matrix error is 0.3 % of its rated load, noise 4 mN, drift 2 mN/min: the truth within 10 mN, 1 mm."""
    gravity = direction(0.10, -0.30, -0.95)
    simulated = in_the_middle(seed=seed)
    found = fit(readings_of(simulated))
    assert found.force.gravity_force_in_base_n[:2] == pytest.approx(gravity[:2], abs=0.01)
    both = found.force.gravity_force_in_base_n[2] + found.force.bias_in_sensor_n[0]
    assert both == pytest.approx(gravity[2] + BIAS[0], abs=0.015)
    assert found.force.bias_in_sensor_n[1:] == pytest.approx(BIAS[1:], abs=0.02)
    assert found.moment.centre_of_mass_in_sensor_mm == pytest.approx(CENTRE_MM, abs=1.2)
    assert found.not_told() == ["gravity along (0, 0, 1) of {B} cannot be told from bias along (1, 0, 0) of {F}"]
    assert found.left_n.max() < 0.01
    require(found)


def test_the_whole_weight_comes_out_where_gravity_lies_in_the_plane():
    simulated = in_the_middle("backend.options.sensor.gravity_direction_in_base=[0.3, -0.95, 0.0]", seed=3)
    found = fit(readings_of(simulated))
    assert found.force.gravity_force_in_base_n[:2] == pytest.approx(direction(0.3, -0.95, 0.0)[:2], abs=0.01)
    assert np.linalg.norm(found.force.gravity_force_in_base_n[:2]) == pytest.approx(WEIGHT_N, abs=0.01)
    assert found.moment.centre_of_mass_in_sensor_mm == pytest.approx(CENTRE_MM, abs=0.5)


def test_the_robot_comes_back_and_the_noise_is_that_of_the_sensor():
    simulated = in_the_middle()
    before = np.array(simulated.operator.wait(lambda r: r is not None, 1.0)["pose_measured"])
    readings = readings_of(simulated, count=6, samples=20)
    after = simulated.operator.wait(lambda r: r is not None, 1.0)
    assert after["pose_measured"] == pytest.approx(before, abs=0.02)
    assert not after["is_busy"]
    assert readings.noise * np.sqrt(20) == pytest.approx([0.004] * 3 + [0.1] * 3, rel=0.4)


def left_after_turning(rig, pose):
    """What the controller calls a force after it turned the empty gripper, unbiased at phi = 0 [N]."""
    rig.home()
    rig.move(162.0, -1.5, 0.0)
    rig.do(Verb.UNBIAS)
    rig.rest()
    rig.move(*pose)
    return float(np.linalg.norm(rig.run(600)["wrench_in_base"][300:, :3].mean(axis=0)))


@pytest.mark.parametrize("phi", [-0.3, 0.3])
def test_with_the_result_the_controller_feels_nothing_where_nothing_touches(make_rig, phi):
    found = fit(readings_of(in_the_middle()))
    force, centre = found.force.gravity_force_in_base_n.tolist(), found.moment.centre_of_mass_in_sensor_mm.tolist()
    result = f"wrench.gravity_force_in_base_n={force}", f"wrench.centre_of_mass_in_sensor_mm={centre}"
    assert left_after_turning(make_rig(BELIEF), (162.0, -1.5, phi)) > 0.1
    assert left_after_turning(make_rig(BELIEF, *result), (162.0, -1.5, phi)) < 0.01


class TestRefusals:
    def test_whatever_is_not_ready_is_told_with_what_to_do(self, make_rig):
        rig = make_rig()
        rig.run(5)
        with pytest.raises(CalibrationError, match=r"not enabled.*DISABLED.*rtctl enable"):
            check_ready(rig.last)
        rig.enable()
        with pytest.raises(CalibrationError, match=r"not homed.*rtctl home"):
            check_ready(rig.last)
        rig.home()
        rig.run(100)
        check_ready(rig.last)
        rig.do(Verb.LOAD_ARRAY)
        with pytest.raises(CalibrationError, match=r"array is loaded.*rtctl unload-array"):
            check_ready(rig.last)
        rig.do(Verb.UNLOAD_ARRAY)
        rig.do(Verb.MOVE_CP, 160.0, -2.0, 0.0)
        with pytest.raises(CalibrationError, match="another motion"):
            check_ready(rig.last)

    def test_a_sensor_that_stops_on_the_way(self):
        simulated = in_the_middle("backend.options.inject.wrench_silent_after_s=12.0")
        with pytest.raises(CalibrationError, match="no valid reading"):
            readings_of(simulated)

    def test_a_sensor_that_was_never_there(self):
        simulated = in_the_middle("backend.options.inject.wrench_silent_after_s=0.0")
        with pytest.raises(CalibrationError, match="no valid reading"):
            readings_of(simulated)

    def test_a_robot_that_fails_on_the_way(self):
        simulated = in_the_middle("backend.options.inject.amplifier_fault_after_s=12.0")
        with pytest.raises((WorkflowError, CalibrationError), match="FAULT"):
            readings_of(simulated)

    def test_a_place_where_the_robot_cannot_turn(self):
        settings = load("planar-sim")
        robot = robots.load(settings.robot.kind, settings.robot.geometry)
        with pytest.raises(CalibrationError, match=r"cannot turn enough.*150.0.*0.3 rad.*rtctl move"):
            poses_about(robot, np.array([150.0, -4.0, 0.0]))

    def test_too_much_force_left(self):
        readings = readings_of(in_the_middle())
        spoilt = readings.wrench_in_sensor.copy()
        spoilt[3, 1] += 0.05  # a cable pulled
        found = fit(Readings(readings.turns, spoilt, readings.noise))
        with pytest.raises(CalibrationError, match=r"pose 4.*0\.0\d+.*0\.03 N.*--bound"):
            require(found)
        require(found, bound_n=0.1)

    def test_not_a_number_is_too_much(self):
        found = fit(readings_of(in_the_middle()))
        with pytest.raises(CalibrationError):
            require(Gravity(found.force, found.moment, np.full(3, np.nan), found.left_nmm))


def test_poses_are_reachable_and_spread_over_the_whole_turn():
    settings = load("planar-sim")
    robot = robots.load(settings.robot.kind, settings.robot.geometry)
    poses = poses_about(robot, np.array([162.0, -1.5, 0.1]), 12)
    assert poses.shape == (12, 3)
    assert (poses[:, :2] == [162.0, -1.5]).all()
    assert all(robot.explain(p) is None for p in poses)
    phi = np.sort(poses[:, 2])
    assert (phi[0], phi[-1]) == pytest.approx((-0.32, 0.32), abs=0.06)
    assert np.diff(phi).max() < 0.13
