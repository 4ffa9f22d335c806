"""The cone of the facial recess (II.2): directions and passages of arrays whose shape is known in closed form."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtctl.electrode.recess import directions_rad, passages_rad

STRAIGHT = np.zeros((4, 4))
ARC = np.zeros((4, 4))
ARC[1, 0] = 0.05
"""theta = s / 20 mm: a circle of radius 20 mm."""
ENTRY = np.array([171.0, 4.0, 0.3])


def with_tip_at_entry(angle, length=18.0):
    """Pose of a straight array that ends in the entry, turned by `angle` against the registered direction."""
    phi = ENTRY[2] + angle
    return np.array([*(ENTRY[:2] - length * np.array([math.cos(phi), math.sin(phi)])), phi])


@given(st.floats(-0.6, 0.6), st.floats(2.0, 12.0))
def test_a_straight_array_through_the_entry_passes_under_its_own_angle(angle, recess_mm):
    pose = with_tip_at_entry(angle)[None]
    # it comes from the right if it points to the left
    assert passages_rad(STRAIGHT, [0.0], pose, [0.0], ENTRY, recess_mm) == pytest.approx([-angle], abs=1e-9)
    assert directions_rad(pose, ENTRY) == pytest.approx([angle])


@given(st.floats(-3.0, 3.0))
def test_a_parallel_offset_is_seen_under_its_tangent(offset):
    pose = with_tip_at_entry(0.0)
    pose[:2] += offset * np.array([-math.sin(ENTRY[2]), math.cos(ENTRY[2])])
    assert passages_rad(STRAIGHT, [0.0], pose[None], [0.0], ENTRY, 6.0) == pytest.approx([math.atan2(offset, 6.0)])


def test_a_bent_array_passes_where_its_circle_does():
    pose = np.array([-15.0, 0.0, 0.0])
    expected = math.atan2(20.0 - math.sqrt(20.0**2 - 9.0**2), 6.0)  # 9 mm from the grip along x, 6 mm before the entry
    found = passages_rad(ARC, [3.0], pose[None], [0.0], np.zeros(3), 6.0)
    assert found == pytest.approx([expected], abs=1e-3)


def test_a_gripper_in_the_recess_has_nothing_left_to_pass():
    assert np.isnan(passages_rad(STRAIGHT, [13.0], with_tip_at_entry(0.1, 5.0)[None], [0.0], ENTRY, 6.0)).all()


def test_an_array_that_does_not_come_as_far_as_the_recess_has_not_passed_it():
    assert np.isnan(passages_rad(STRAIGHT, [0.0], with_tip_at_entry(0.0, 40.0)[None], [0.0], ENTRY, 6.0)).all()
