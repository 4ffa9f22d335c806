"""Three linear axes and a rotation: complex numbers for its plane, and the planar robot beside it."""

import cmath
import math

import numpy as np
import pytest

from hal.errors import OptionError
from rtctl import robots
from rtctl.robots import interface

POSE = [160.0, 2.0, -3.0, 0.1]


@pytest.fixture(scope="module")
def robot():
    return robots.load("cartesian_4", {})


def test_axes_stand_behind_the_gripper():
    robot = robots.load("cartesian_4", {"gripper_mm": [80.0, 5.0], "gear_ratio": 50.0})
    axis = 160 + 2j - (80 + 5j) * cmath.exp(0.1j)
    joint, motor = robot.inverse(POSE)
    assert joint == pytest.approx([axis.real, axis.imag, -3.0, 0.1], abs=1e-13)
    assert motor * [0.097, 0.097, 0.097, 1 / 50] == pytest.approx(joint - [70.0, -5.0, 0.0, 0.0], abs=1e-13)


def test_every_motor_moves_what_it_should(robot):
    """One turn of a linear motor shifts the gripper along its axis; one of the rotation swings it about the axis."""
    _, motor = robot.inverse(POSE)
    for i in range(3):
        moved = robot.forward(motor + 2 * math.pi * np.eye(4)[i])
        assert moved - POSE == pytest.approx(0.097 * 2 * math.pi * np.eye(4)[i], abs=1e-12)
    moved = robot.forward(motor + 10.0 * np.eye(4)[3])
    swing = 88 * (cmath.exp(0.2j) - cmath.exp(0.1j))
    assert moved - POSE == pytest.approx([swing.real, swing.imag, 0.0, 0.1], abs=1e-12)


def test_in_its_plane_it_stands_as_the_planar_robot(robot):
    planar = robots.load("planar_3rpr", {})
    x, y, _, phi = POSE
    assert robot.rotation(POSE).tolist() == planar.rotation([x, y, phi]).tolist()
    assert [robot.pose_names[i] for i in (0, 1, 3)] == list(planar.pose_names)
    for side in ("low", "high"):
        assert robot.record[f"box_{side}"][0, [0, 1, 3]].tolist() == planar.record[f"box_{side}"][0].tolist()


def test_explain_names_the_axis_at_its_limit():
    """The box is larger than the travels: the swing of the gripper takes c_y out, and phi has stops of its own."""
    robot = robots.load("cartesian_4", {"travel_high_mm_rad": [95.0, 30.0, 5.0, 0.3]})
    for pose, what, bound in (
        ([160.0, 8.0, 0.0, -0.3], "c_y_mm", "-30 .. 30 mm"),
        ([160.0, 0.0, 6.0, 0.0], "c_z_mm", "-20 .. 5 mm"),
        ([160.0, 0.0, 0.0, 0.31], "phi_rad", "-0.5 .. 0.3 rad"),
    ):
        problem = robot.explain(pose)
        assert robot.reach(pose) == interface.STROKE_LIMIT
        assert problem.what.startswith(what)
        assert problem.bound == bound


def test_no_pose_is_singular(robot):
    rng = np.random.default_rng(4)
    poses = rng.uniform(robot.record["box_low"][0], robot.record["box_high"][0], (200, 4))
    assert {robot.reach(pose) for pose in poses} == {interface.REACHABLE, interface.STROKE_LIMIT}
    determinants = [np.linalg.det(robot.jacobian(pose)) for pose in poses]
    assert determinants == pytest.approx([100 / 0.097**3] * 200, rel=1e-12)


@pytest.mark.parametrize(
    "table", [{"gear_ratio": 0.0}, {"travel_low_mm_rad": [95.0, -30, -20, -0.5]}, {"lead_mm_per_rad": [0.1] * 4}]
)
def test_bad_options_are_refused(table):
    with pytest.raises(OptionError, match=r"robot\.geometry"):
        robots.load("cartesian_4", table)
