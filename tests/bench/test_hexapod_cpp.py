"""The hexapod's forward kinematics in C++ is a second implementation: both must agree to the bit, whatever the angles."""

import numpy as np
import pytest

from bench.kinematics_cost import NativeForward, forward_many, motion
from bench.native import compiler
from rtctl import robots

pytestmark = pytest.mark.skipif(compiler() is None, reason="no g++ on this machine")


@pytest.fixture(scope="module")
def robot():
    return robots.load("hexapod", {})


@pytest.fixture(scope="module")
def native(robot, tmp_path_factory):
    return NativeForward(robot, tmp_path_factory.mktemp("native"))


def both(robot, native, motor, start):
    ours, theirs = [(start.copy(), np.zeros(len(motor), np.int64)) for _ in range(2)]
    forward_many(robot.record, motor, *ours)
    native(robot.record, motor, *theirs)
    return ours, theirs


def test_along_a_motion(robot, native):
    motor, start = motion(robot, 2000)
    (poses, steps), (other_poses, other_steps) = both(robot, native, motor, start)
    assert (poses == other_poses).all()
    assert (steps == other_steps).all()
    assert set(steps) <= {1, 2, 3}
    assert np.array([robot.inverse(pose)[1] for pose in poses]) == pytest.approx(motor, abs=1e-9)


def test_from_home_and_where_there_is_no_answer(robot, native):
    rng = np.random.default_rng(4)
    motor = rng.uniform(-300, 300, (500, 6))
    motor[::50, 2] = np.nan
    start = np.tile(robot.home_pose, (len(motor), 1))
    (poses, steps), (other_poses, other_steps) = both(robot, native, motor, start)
    assert np.array_equal(poses, other_poses, equal_nan=True)
    assert (steps == other_steps).all()
    assert (steps[::50] == -1).all()
    assert (poses[steps < 0] == robot.home_pose).all()
    assert (steps > 0).sum() > 100
