"""What every robot must be able to do, whatever its mechanism: the same properties over all there are.

A robot that is added to `KINDS` is tested here with its default geometry; add to `VARIANTS` one that shows more of it.
"""

import itertools

import numba
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from hal.errors import OptionError
from hal.options import read, table_of
from rtctl import robots
from rtctl.robots import interface
from rtctl.robots.robot import _forward as forward
from rtctl.robots.robot import _inverse as inverse

VARIANTS = [
    ("planar_3rpr", {"pulley_radius_mm": [0.0, 2.0, 5.0], "eta_mm_per_rad": [0.1, 0.2, 0.3]}),
    ("cartesian_4", {"gripper_mm": [40.0, -25.0], "home_mm_rad": [150.0, 1.0, 2.0, 0.1], "travel_low_mm_rad": [90, -10, -20, -0.5], "travel_high_mm_rad": [145, 60, 20, 0.5]}),
    ("hexapod", {"home_mm_rad": [3.0, -2.0, 195.0, 0.05, -0.04, 0.1], "lead_mm_per_rad": [0.1, 0.2, 0.3, 0.1, 0.2, 0.3], "leg_min_mm": [95.0, 90.0, 85.0, 95.0, 90.0, 85.0]}),
]  # fmt: skip
CASES = [*((kind, {}) for kind in robots.KINDS), *VARIANTS]
NAMES = [f"{kind}{'' if table == {} else ' varied'}" for kind, table in CASES]
TICK_S = 0.001


@pytest.fixture(scope="module", params=CASES, ids=NAMES)
def robot(request):
    kind, table = request.param
    return robots.load(kind, table)


def box(robot):
    return robot.record["box_low"][0], robot.record["box_high"][0]


def poses(robot, count, seed=1):
    """Poses (count, dof) that the robot may go to, spread over its box."""
    rng, low, high = np.random.default_rng(seed), *box(robot)
    found = (pose for pose in rng.uniform(low, high, (100 * count, robot.dof)) if robot.reach(pose) == 0)
    chosen = list(itertools.islice(found, count))
    assert len(chosen) == count, "the box is hardly reachable"
    return np.array(chosen)


def units(robot):
    """A small step of every entry of the pose: lengths [mm] and angles [rad] that move the gripper alike."""
    return np.repeat([1.0, 0.02], [robot.length_dofs, robot.dof - robot.length_dofs])


@numba.njit
def translate(record, pose, offset):
    interface.translate(record[0], pose, offset)


# --- what it says of itself ---------------------------------------------------------------------------------------


def test_it_is_named_and_measured(robot):
    dof = robot.dof
    assert robot.kind in robots.KINDS
    assert len(robot.joint_names) == len(robot.joint_units) == dof
    assert set(robot.joint_units) <= {"mm", "rad"}
    assert [name.rsplit("_", 1)[1] for name in robot.pose_names] == ["mm"] * robot.length_dofs + ["rad"] * (dof - robot.length_dofs)  # fmt: skip
    assert sum(robot.translation_mask) == robot.length_dofs
    assert robot.record.shape == (1,)
    for name in ("home_pose", "box_low", "box_high", "joint_low", "joint_high"):
        assert robot.record[name].shape == (1, dof)


def test_home_is_home(robot):
    joint, motor = robot.inverse(robot.home_pose)
    assert np.abs(motor).max() < 1e-10
    assert np.isfinite(joint).all()
    assert robot.explain(robot.home_pose) is None
    copy = robot.home_pose
    copy[:] = 0.0
    assert (robot.home_pose != copy).any()


def test_fingerprint_tells_geometries_apart():
    prints = [robots.fingerprint(kind, table) for kind, table in CASES]
    assert len(set(prints)) == len(CASES)


@pytest.mark.parametrize("kind", robots.KINDS)
def test_defaults_written_out_are_the_same_robot(kind):
    written = table_of(read(robots.GEOMETRIES[kind], {}))
    assert (robots.load(kind, written).record == robots.load(kind, {}).record).all()
    assert robots.fingerprint(kind, written) == robots.fingerprint(kind, {})


# --- kinematics ---------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(share=st.lists(st.floats(0, 1), min_size=6, max_size=6))
def test_forward_inverts_inverse(robot, share):
    low, high = box(robot)
    pose = low + np.array(share[: robot.dof]) * (high - low)
    assume(robot.reach(pose) == interface.REACHABLE)
    _, motor = robot.inverse(pose)
    found = robot.forward(motor)
    assert found == pytest.approx(pose, abs=1e-10)
    assert robot.inverse(found)[1] == pytest.approx(motor, abs=1e-9)


def test_a_tick_later_forward_takes_few_steps(robot):
    for pose in poses(robot, 20):
        later = pose + units(robot) * 10 * TICK_S  # 10 mm/s
        found = pose.copy()
        assert 1 <= forward(robot.record, robot.inverse(later)[1], found) <= 3
        assert found == pytest.approx(later, abs=1e-11)


def test_jacobian_is_the_difference_quotient(robot):
    """Of fourth order, so that steps are large against rounding."""
    for pose in poses(robot, 10):
        jacobian = robot.jacobian(pose)
        for k, unit in enumerate(units(robot)):
            h = np.zeros(robot.dof)
            h[k] = 1e-2 * unit
            inner, outer = (robot.inverse(pose + n * h)[1] - robot.inverse(pose - n * h)[1] for n in (1, 2))
            assert jacobian[:, k] == pytest.approx((8 * inner - outer) / (12 * h[k]), rel=1e-8, abs=1e-6)


def test_motors_are_independent_wherever_it_may_go(robot):
    for pose in poses(robot, 50):
        assert np.linalg.cond(robot.jacobian(pose) * units(robot)) < 1e4


def test_rotation_is_a_rotation_that_translations_leave_alone(robot):
    offset = np.array([0.3, -0.2, 0.1])
    for pose in poses(robot, 10):
        before = robot.rotation(pose)
        assert before @ before.T == pytest.approx(np.eye(3), abs=1e-14)
        assert np.linalg.det(before) == pytest.approx(1.0)
        moved = pose.copy()
        translate(robot.record, moved, offset)
        mask = np.array(robot.translation_mask)
        assert moved - pose == pytest.approx([*offset[mask], *[0] * (robot.dof - robot.length_dofs)], abs=1e-13)
        assert (robot.rotation(moved) == before).all()


# --- refusals -----------------------------------------------------------------------------------------------------


def test_explain_is_silent_exactly_where_the_robot_may_go(robot):
    low, high = box(robot)
    around = np.random.default_rng(3).uniform(low - 0.02 * (high - low), high + 0.02 * (high - low), (300, robot.dof))
    answers = [(robot.reach(pose), robot.explain(pose)) for pose in around]
    assert all((answer == interface.REACHABLE) == (problem is None) for answer, problem in answers)
    assert {interface.REACHABLE, interface.OUTSIDE_BOX} <= {answer for answer, _ in answers}


def test_explain_names_the_entry_outside_the_box(robot):
    low, high = box(robot)
    for k, (name, unit) in enumerate(zip(robot.pose_names, units(robot), strict=True)):
        for limit, side in ((low, -1), (high, 1)):
            pose = robot.home_pose
            pose[k] = limit[k] + side * 1e-9
            assert robot.reach(pose) == interface.OUTSIDE_BOX
            problem = robot.explain(pose)
            assert problem.what.startswith(name)
            assert problem.value == pose[k]
            assert problem.bound == f"{low[k]:g} .. {high[k]:g} {'mm' if unit == 1.0 else 'rad'}"


def test_a_pose_with_nan_is_nowhere(robot):
    for k in range(robot.dof):
        pose = robot.home_pose
        pose[k] = np.nan
        joint, motor = np.zeros(robot.dof), np.zeros(robot.dof)
        assert not inverse(robot.record, pose, joint, motor)
        assert np.isnan(joint).all()
        assert np.isnan(motor).all()
        assert robot.reach(pose) == interface.OUTSIDE_BOX
        assert robot.explain(pose).what.startswith(robot.pose_names[k])
        with pytest.raises(robots.RobotError, match="no assembly"):
            robot.inverse(pose)


@pytest.mark.parametrize("nonsense", [np.nan, np.inf, -np.inf])
def test_motor_angles_that_are_no_numbers_leave_the_pose(robot, nonsense):
    start = poses(robot, 1)[0]
    for k in range(robot.dof):
        motor, pose = np.zeros(robot.dof), start.copy()
        motor[k] = nonsense
        assert forward(robot.record, motor, pose) == -1
        assert (pose == start).all()
        with pytest.raises(robots.RobotError, match="does not converge"):
            robot.forward(motor)


def test_wrong_shapes_never_reach_compiled_code(robot):
    for call in (robot.inverse, robot.forward, robot.jacobian, robot.rotation, robot.reach, robot.explain):
        with pytest.raises(robots.RobotError, match="wrong shape"):
            call([1.0, 2.0])
    with pytest.raises(robots.RobotError, match="start"):
        robot.forward(np.zeros(robot.dof), [1.0])


@pytest.mark.parametrize("kind", robots.KINDS)
def test_boxes_that_are_none_and_boxes_without_home_are_refused(kind):
    """`box_low_mm_rad` is an option of every robot."""
    robot = robots.load(kind, {})
    low, high = box(robot)
    for k, name in enumerate(robot.pose_names):
        empty, aside = low.copy(), low.copy()
        empty[k], aside[k] = high[k], 0.5 * (robot.home_pose[k] + high[k])
        with pytest.raises(OptionError, match=rf"box_low_mm_rad\[{k}\] is not below box_high_mm_rad"):
            robots.load(kind, {"box_low_mm_rad": empty.tolist()})
        with pytest.raises(robots.RobotError, match=f"home is not usable: {name}"):
            robots.load(kind, {"box_low_mm_rad": aside.tolist()})


@pytest.mark.parametrize("kind", robots.KINDS)
def test_unknown_options_are_refused(kind):
    with pytest.raises(OptionError, match=r"unknown key robot\.geometry\.box_low_mm"):
        robots.load(kind, {"box_low_mm": [0.0]})


def test_unknown_robot_is_refused():
    with pytest.raises(OptionError, match="unknown robot"):
        robots.load("hexapus", {})
