"""Orientation in space against scipy's Rotation."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rtctl.robots import orientation

turn = st.floats(-np.pi, np.pi)
tilt = st.floats(-1.57, 1.57)


def reference(alpha, beta, gamma):
    return Rotation.from_euler("ZYX", [gamma, beta, alpha])


@settings(max_examples=100, deadline=None)
@given(turn, tilt, turn)
@example(np.pi, 0.0, -np.pi)
@example(0.3, np.pi / 2, 0.2)
def test_matrix_and_quaternion_of_euler_angles(alpha, beta, gamma):
    wanted = reference(alpha, beta, gamma).as_matrix()
    quaternion = orientation.quaternion_of_euler(alpha, beta, gamma)
    assert np.reshape(orientation.matrix_of_euler(alpha, beta, gamma), (3, 3)) == pytest.approx(wanted, abs=1e-15)
    assert np.reshape(orientation.matrix_of_quaternion(quaternion), (3, 3)) == pytest.approx(wanted, abs=2e-15)
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-15)


@settings(max_examples=100, deadline=None)
@given(turn, st.floats(-1.5, 1.5), turn, st.sampled_from([-1.0, 1.0]))
def test_euler_angles_come_back_from_either_quaternion(alpha, beta, gamma, sign):
    q = tuple(sign * component for component in orientation.quaternion_of_euler(alpha, beta, gamma))
    found = np.array(orientation.euler_of_quaternion(q))
    assert np.angle(np.exp(1j * (found - (alpha, beta, gamma)))) == pytest.approx(np.zeros(3), abs=1e-13)


def test_euler_angles_at_the_pole_are_numbers():
    """Rounding may carry sin beta above 1."""
    q = orientation.quaternion_of_euler(0.0, np.pi / 2, 0.0)
    _, beta, _ = orientation.euler_of_quaternion(tuple(1.000000001 * component for component in q))
    assert beta == np.pi / 2


@settings(max_examples=100, deadline=None)
@given(turn, tilt, turn, st.tuples(*[st.floats(-0.01, 0.01)] * 3))
def test_a_small_turn_comes_after_in_the_base(alpha, beta, gamma, vector):
    """By hand: the difference to the exact turn is below |v|^3 / 12."""
    before = reference(alpha, beta, gamma)
    w, x, y, z = orientation.turned(orientation.quaternion_of_euler(alpha, beta, gamma), *vector)
    wanted = Rotation.from_rotvec(vector) * before
    assert (Rotation.from_quat([x, y, z, w]) * wanted.inv()).magnitude() < np.linalg.norm(vector) ** 3 / 11 + 1e-15
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0, abs=1e-15)


def angular_velocity(angles, rates, step=1e-4):
    """Of the turn that passes `angles` at `rates`, from differences of rotations."""
    ahead, behind = (reference(*(angles + side * step * rates)) for side in (1, -1))
    return (ahead * behind.inv()).as_rotvec() / (2 * step)


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.3, -1.2, 2.5), (-2.0, 0.7, -0.4)])
def test_euler_rates_and_angular_velocity(angles):
    angles, rates = np.array(angles), np.array([0.4, -0.3, 0.9])
    velocity = angular_velocity(angles, rates)
    row = np.array([3.0, -1.0, 2.0])
    assert np.dot(orientation.per_euler_rates(*angles[1:], *row), rates) == pytest.approx(row @ velocity, abs=1e-7)
