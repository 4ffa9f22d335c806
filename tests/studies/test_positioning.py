"""The position loop on the plant, measured as in D III.8, and its model of independent joint errors (05 section 5)."""

import math

import numpy as np
import pytest

from rtctl.robots.planar_3rpr import load
from studies import positioning
from studies.positioning import AS_DRAWN, PRINTED, accuracy, calibrated, cycle, joint_noise, repeatability, trials

DEGREES = np.array([1.0, 1.0, math.degrees(1.0)])


@pytest.fixture(scope="module")
def before():
    return trials(AS_DRAWN, count=2, points=4)


@pytest.fixture(scope="module")
def after():
    return trials(calibrated(poses=60), count=2, points=4)


def test_calibration_more_than_halves_the_error_in_every_coordinate(before, after):
    assert (2.0 * accuracy(*after) < accuracy(*before)).all()
    assert (4.0 * repeatability(after[1]) < repeatability(before[1])).all()


def test_after_calibration_the_loop_is_as_good_as_the_source_measured(after):
    """The printed rows are bounds here, not targets: the plant has no tracker, and stops that do not wear."""
    assert (accuracy(*after) * DEGREES < PRINTED["accuracy"]).all()
    assert (repeatability(after[1]) * DEGREES < PRINTED["repeatability"]).all()


def test_before_calibration_the_backlash_is_what_does_not_repeat(before):
    """From one side everything repeats to micrometres; from either, x is out by half a backlash, 0.09 mm, at most."""
    _, true = before
    one, either = repeatability(true, either_side=False), repeatability(true)
    assert (one < [0.002, 0.01, 1e-4]).all()
    assert 0.01 < either[0] < 0.093
    assert either[1] > 10 * one[1]


def test_the_cycle_is_isolated_and_goes_both_ways():
    poses = cycle(5)
    middle = positioning.BOX.mean(axis=0)
    for k in range(3):
        others = [i for i in range(3) if i != k]
        assert (poses[k][..., others] == middle[others]).all()
        assert poses[k, 0, :, k] == pytest.approx(np.linspace(*positioning.BOX[:, k], 5))
        assert (poses[k, 1] == poses[k, 0, ::-1]).all()


def test_repeatability_is_taken_point_by_point():
    """Two trials, a constant error of 1 mm everywhere and 0.1 mm of lost motion between up and down."""
    desired = np.zeros((3, 2, 4, 3)) + np.arange(4)[:, None]
    desired[:, 1] = desired[:, 0, ::-1]
    true = np.array([desired + 1.0, desired + 1.0])
    true[:, :, 0] += 0.05
    true[:, :, 1] -= 0.05
    assert accuracy(desired, true) == pytest.approx([math.hypot(1.0, 0.05)] * 3)
    assert repeatability(true) == pytest.approx([0.05] * 3)
    assert repeatability(true, either_side=False) == pytest.approx([0.0] * 3, abs=1e-12)
    true[1] += 0.02
    assert repeatability(true, either_side=False) == pytest.approx([0.01] * 3)


def test_independent_joint_errors_of_05_section_5():
    robot = load({})
    small = joint_noise(robot, 0.085, draws=6000) * DEGREES
    assert small[1:] == pytest.approx([0.128, 0.044], rel=0.1)
    large = joint_noise(robot, 0.5, draws=6000, seed=1) * DEGREES
    assert large[1:] == pytest.approx(small[1:] * 0.5 / 0.085, rel=0.05)
    assert large[1:] == pytest.approx(PRINTED["accuracy"][1:], rel=0.1)
