"""The 6-UPS platform against 01 section 2: printed identities, scipy's Rotation, singularities."""

import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hal.errors import OptionError
from rtctl import robots, wrench
from rtctl.robots import interface
from rtctl.robots.robot import _forward as forward

LEAD = 0.097
TABLE = [
    ((0, 0, 200, 0, 0, 0), (115.272257305,) * 6),
    ((0, -10, 205, 0, 0, 0), (119.700883085, 122.456752436, 123.207337890, 117.666216470, 118.447162866, 121.231535488)),
    ((0, 0, 200, 0, 15, 0), (121.449301042, 113.329130897, 127.025876772, 127.025876772, 113.329130897, 121.449301042)),
    ((12, -8, 210, 8, -6, 4), (129.226839168, 135.107202946, 126.244803326, 125.740035602, 130.539330317, 121.035766013)),
    ((7.5, 7.5, 207.5, 5, 5, 5), (126.301545740, 122.454579598, 124.047083853, 128.816019207, 123.988200469, 118.650041758)),
]  # fmt: skip
SKEW = (12, -8, 210, 8, -6, 4)
RANGE = np.array([(-20, 20), (-20, 20), (185, 215), (-15, 15), (-15, 15), (-15, 15)], float)
WIDE = {
    "box_low_mm_rad": [-100.0, -100.0, 100.0, -1.4, -1.4, -3.0],
    "box_high_mm_rad": [100.0, 100.0, 300.0, 1.4, 1.4, 3.0],
    "leg_min_mm": [10.0] * 6,
    "leg_max_mm": [300.0] * 6,
}


@pytest.fixture(scope="module")
def robot():
    return robots.load("hexapod", {})


@pytest.fixture(scope="module")
def wide():
    return robots.load("hexapod", WIDE)


def degrees(x, y, z, alpha, beta, gamma):
    return np.array([x, y, z, *np.radians([alpha, beta, gamma])])


def euler_rate_matrix(pose):
    """T of 01 section 2: angular velocity of the rates of alpha, beta, gamma."""
    (cb, sb), (cg, sg) = ((math.cos(a), math.sin(a)) for a in pose[4:])
    return np.array([[cg * cb, -sg, 0], [sg * cb, cg, 0], [-sb, 0, 1]])


def of_twist(robot, pose):
    """Leg lengths per velocity and angular velocity: J."""
    return (
        LEAD
        * robot.jacobian(pose)
        @ np.block([[np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), np.linalg.inv(euler_rate_matrix(pose))]])
    )


# --- identities ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("pose", "legs"), TABLE)
def test_table_of_legs(robot, pose, legs):
    joint, motor = robot.inverse(degrees(*pose))
    assert joint == pytest.approx(legs, abs=6e-10)
    assert motor == pytest.approx((np.array(legs) - TABLE[0][1]) / LEAD, abs=2e-8)


def test_row_of_the_jacobian(robot):
    printed = (-0.116473564, 0.121923384, 0.985681793, 48.796158291, -20.838100096, 8.343579241)
    assert of_twist(robot, degrees(*SKEW))[0] == pytest.approx(printed, abs=6e-10)


def test_condition_and_error_box_at_home(robot):
    jacobian = of_twist(robot, robot.home_pose)
    assert np.linalg.cond(jacobian @ np.diag([1, 1, 1, 1 / 90, 1 / 90, 1 / 90])) == pytest.approx(66 / 7, abs=6e-10)
    box = 0.02 * np.abs(np.linalg.inv(jacobian)).sum(axis=1)
    assert box[:3] == pytest.approx([0.094537, 0.085414, 0.020959], abs=6e-7)


def test_pure_yaw_makes_two_alternating_lengths(robot):
    joint, _ = robot.inverse(degrees(0, 0, 200, 0, 0, 10))
    assert joint[::2] == pytest.approx([joint[0]] * 3, abs=1e-12)
    assert joint[1::2] == pytest.approx([joint[1]] * 3, abs=1e-12)
    assert abs(joint[0] - joint[1]) > 1.0


def test_forward_over_the_range_in_six_steps_from_home(robot):
    low, high = RANGE.T
    poses = [*itertools.product(*RANGE), *np.random.default_rng(1).uniform(low, high, (1000, 6))]
    for pose in (degrees(*p) for p in poses):
        found = robot.home_pose
        assert 1 <= forward(robot.record, robot.inverse(pose)[1], found) <= 6
        assert np.abs(found - pose).max() <= 1e-12


# --- frames -------------------------------------------------------------------------------------------------------


def test_legs_end_where_the_turned_platform_is(robot):
    pose = degrees(*SKEW)
    platform = pose[:3] + Rotation.from_euler("ZYX", pose[:2:-1]).apply(robot.record["platform_mm"][0])
    lengths = np.linalg.norm(platform - robot.record["base_mm"][0], axis=1)
    assert robot.inverse(pose)[0] == pytest.approx(lengths, abs=1e-12)


def test_tool_axis_is_the_insertion_axis_and_the_sensor_is_parallel_to_the_tip(robot):
    assert robot.rotation(robot.home_pose)[:, 0].tolist() == [0, 0, 1]
    pose = degrees(*SKEW)
    tip = Rotation.from_euler("ZYX", pose[:2:-1]).as_matrix()
    gripper = robot.rotation(pose)
    assert gripper[:, 0] == pytest.approx(tip[:, 2], abs=1e-15)
    force_in_base, force_in_sensor = np.array([1.0, -2.0, 3.0]), np.empty(3)
    wrench.into_sensor(gripper, force_in_base, force_in_sensor)
    assert force_in_sensor == pytest.approx(tip.T @ force_in_base, abs=1e-14)


# --- where forward kinematics ends --------------------------------------------------------------------------------


def test_legs_that_do_not_meet_leave_the_pose(robot):
    legs = np.array([10.0, 300.0, 10.0, 300.0, 10.0, 300.0])
    pose = robot.home_pose
    assert forward(robot.record, (legs - 115.272257305) / LEAD, pose) == -1
    assert (pose == robot.home_pose).all()


@pytest.mark.parametrize("k", range(6))
def test_forward_does_not_start_from_nan(robot, k):
    pose = robot.home_pose
    pose[k] = math.nan
    assert forward(robot.record, np.zeros(6), pose) == -1
    assert np.isnan(pose).tolist() == [i == k for i in range(6)]


def test_forward_with_large_angles(wide):
    pose = degrees(5, -5, 190, -50, 60, 40)
    found = wide.forward(wide.inverse(pose)[1], degrees(5, -5, 190, -45, 55, 35))
    assert found == pytest.approx(pose, abs=1e-11)


# --- limits -------------------------------------------------------------------------------------------------------


def test_the_range_of_the_sources_is_reachable_but_for_legs(robot):
    answers = [robot.reach(degrees(*pose)) for pose in itertools.product(*RANGE)]
    assert set(answers) <= {interface.REACHABLE, interface.STROKE_LIMIT}
    rng = np.random.default_rng(2)
    low, high = RANGE.T
    assert {robot.reach(degrees(*pose)) for pose in rng.uniform(low, high, (500, 6))} == {interface.REACHABLE}


def test_explain_names_the_leg_at_its_limit(robot):
    pose = np.array([20.0, 20.0, 215.0, 0.262, 0.262, -0.262])
    joint, _ = robot.inverse(pose)
    problem = robot.explain(pose)
    assert robot.reach(pose) == interface.STROKE_LIMIT
    assert problem.what.startswith(robot.joint_names[int(np.argmax(joint))])
    assert (problem.value, problem.bound) == (joint.max(), "90 .. 160 mm")


@pytest.mark.parametrize("side", [-1, 1])
def test_yaw_of_90_degrees_is_singular_and_beyond_is_another_assembly(wide, side):
    """Fichter (1986): a platform parallel to its base is singular at a yaw of 90 deg, whatever its height."""
    for z in (150.0, 200.0, 250.0):
        before, at, beyond = (degrees(0, 0, z, 0, 0, side * angle) for angle in (20, 90, 130))
        assert np.linalg.svd(wide.jacobian(at) / np.array([1, 1, 1, 90, 90, 90]), compute_uv=False)[-1] < 1e-12
        assert wide.reach(before) == interface.REACHABLE
        for pose in (at, beyond):
            assert wide.reach(pose) == interface.SINGULAR
            assert wide.explain(pose).bound == "0.2 or larger"
        assert wide.explain(at).value == pytest.approx(0.0, abs=1e-12)
        assert wide.explain(beyond).value < -0.1


def test_margin_is_the_determinant_over_that_at_home(wide):
    home = np.linalg.det(of_twist(wide, wide.home_pose))
    for pose in (degrees(0, 0, 200, 0, 0, 85), degrees(30, -20, 240, 70, -60, 80)):
        expected = np.linalg.det(of_twist(wide, pose)) / home
        assert wide.singular_error(pose).value == pytest.approx(expected, abs=1e-12)


def test_legs_side_by_side_have_no_home():
    """Base and platform of one shape, leg by leg: nothing holds the yaw."""
    platform = robots.load("hexapod", {}).record["base_mm"][0] / 2 - [0, 0, 90]
    with pytest.raises(robots.RobotError, match="home is not usable: it is a singularity"):
        robots.load("hexapod", {"platform_mm": platform.tolist()})


@pytest.mark.parametrize(
    "table",
    [
        {"leg_min_mm": [90.0] * 5 + [160.0]},
        {"box_high_mm_rad": [20.0, 20.0, 215.0, 0.262, 1.55, 0.262]},
        {"platform_mm": [[35.0, 0.0, -90.0]] * 5},
        {"lead_mm_per_rad": [0.097] * 5 + [0.0]},
    ],
)
def test_bad_options_are_refused(table):
    with pytest.raises(OptionError, match=r"robot\.geometry"):
        robots.load("hexapod", table)


def test_home_with_a_leg_too_long_is_refused():
    with pytest.raises(robots.RobotError, match="home is not usable: l1_mm"):
        robots.load("hexapod", {"leg_max_mm": [115.0] * 6})
