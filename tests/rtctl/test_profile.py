"""Piecewise cubic profiles against integration, limits, and ruckig's velocity interface."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from ruckig import ControlInterface, InputParameter, Result, Ruckig, Trajectory

from hal.kernel import kernel
from rtctl import profile as profiles
from rtctl.memory import profile_dtype

ACCELERATION, JERK = 40.0, 400.0
velocity = st.floats(-10.0, 10.0)
acceleration = st.floats(-ACCELERATION, ACCELERATION)


@kernel
def build(profile, position, v, a, target, limit_a, limit_j):
    profiles.clear(profile[0], 0)
    profiles.append_velocity_change(profile[0], 0, position, v, a, target, limit_a, limit_j)


@kernel
def sample(profile, channel, times, result):
    for k in range(times.shape[0]):
        p, v, a = profiles.evaluate(profile[0], channel, times[k])
        result[k, 0], result[k, 1], result[k, 2] = p, v, a


def change_of_velocity(position, v, a, target, limit_a=ACCELERATION, limit_j=JERK):
    profile = np.zeros(1, profile_dtype(3))
    build(profile, position, v, a, target, limit_a, limit_j)
    return profile


def sampled(profile, times, channel=0):
    result = np.empty((len(times), 3))
    sample(profile, channel, np.asarray(times), result)
    return result


@given(v=velocity, a=acceleration, target=velocity)
def test_a_change_of_velocity_ends_at_the_target_without_acceleration_and_stays(v, a, target):
    profile = change_of_velocity(3.0, v, a, target)
    end = float(profile["duration_s"][0])
    after = sampled(profile, [end, end + 1.0])
    assert after[:, 1] == pytest.approx(target, abs=1e-9)
    assert after[:, 2] == pytest.approx(0.0, abs=1e-9)
    assert after[1, 0] - after[0, 0] == pytest.approx(target, abs=1e-9)


@given(v=velocity, a=acceleration, target=velocity)
def test_a_change_of_velocity_is_continuous_and_keeps_the_limits(v, a, target):
    profile = change_of_velocity(-7.0, v, a, target)
    count, end = int(profile["segments"][0, 0]), float(profile["duration_s"][0])
    assert sampled(profile, [0.0])[0] == pytest.approx([-7.0, v, a], abs=1e-9)
    for border in profile["start_s"][0, 0, 1:count]:
        before, after = sampled(profile, [np.nextafter(border, -1.0), border])
        assert before == pytest.approx(after, abs=1e-9)
    s = sampled(profile, np.linspace(0.0, end + 0.01, 500))
    assert np.abs(s[:, 2]).max() <= ACCELERATION + 1e-9
    assert np.abs(profile["jerk"][0, 0, :count]).max() <= JERK
    extreme = v + 0.5 * a * abs(a) / JERK  # what the present acceleration cannot avoid
    low, high = min(v, target, extreme), max(v, target, extreme)
    assert s[:, 1].min() >= low - 1e-9
    assert s[:, 1].max() <= high + 1e-9


@given(v=velocity, a=acceleration, target=velocity)
def test_values_are_the_integrals_of_the_jerk(v, a, target):
    profile = change_of_velocity(1.0, v, a, target)
    count, end = int(profile["segments"][0, 0]), float(profile["duration_s"][0])
    at, (p, w, b) = 0.0, (1.0, v, a)
    starts = [*profile["start_s"][0, 0, :count], end + 0.1]
    for k in range(count):
        t, j = starts[k + 1] - starts[k], profile["jerk"][0, 0, k]
        p, w, b = p + w * t + b * t**2 / 2 + j * t**3 / 6, w + b * t + j * t**2 / 2, b + j * t
        at += t
        assert sampled(profile, [np.nextafter(starts[k + 1], -1)])[0] == pytest.approx([p, w, b], abs=1e-8)
    assert at == pytest.approx(end + 0.1)


@given(v=velocity, a=acceleration, target=velocity)
def test_a_change_of_velocity_takes_as_long_as_an_independent_solver_needs(v, a, target):
    solver, inputs, trajectory = Ruckig(1), InputParameter(1), Trajectory(1)
    inputs.control_interface = ControlInterface.Velocity
    inputs.current_position, inputs.current_velocity, inputs.current_acceleration = [0.0], [v], [a]
    inputs.target_velocity, inputs.target_acceleration = [target], [0.0]
    inputs.max_acceleration, inputs.max_jerk = [ACCELERATION], [JERK]
    assume(solver.calculate(inputs, trajectory) in (Result.Working, Result.Finished))
    profile = change_of_velocity(0.0, v, a, target)
    assert float(profile["duration_s"][0]) == pytest.approx(trajectory.duration, abs=1e-7)
    for t in np.linspace(0.0, trajectory.duration, 7):
        p, w, b = trajectory.at_time(t)
        assert sampled(profile, [t])[0] == pytest.approx([p[0], w[0], b[0]], abs=1e-5)


def test_an_acceleration_beyond_a_lowered_limit_is_still_brought_to_rest():
    profile = change_of_velocity(0.0, 5.0, 60.0, 0.0, limit_a=20.0)
    end = float(profile["duration_s"][0])
    assert sampled(profile, [end])[0, 1:] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_nothing_to_change_is_an_empty_motion():
    profile = change_of_velocity(4.0, 0.0, 0.0, 0.0)
    assert profile["duration_s"][0] == 0.0
    assert sampled(profile, [0.0, 5.0]).tolist() == [[4.0, 0.0, 0.0], [4.0, 0.0, 0.0]]


def test_the_duration_is_that_of_the_slowest_channel():
    profile = np.zeros(1, profile_dtype(3))
    build(profile, 0.0, 8.0, 0.0, 0.0, ACCELERATION, JERK)
    first = float(profile["duration_s"][0])
    add(profile, 1, 0.5)
    assert float(profile["duration_s"][0]) == first
    assert profile["segments"][0].tolist() == [4, 3, 0, 0]
    assert first == pytest.approx(8.0 / ACCELERATION + ACCELERATION / JERK)


@kernel
def add(profile, channel, v):
    profiles.append_velocity_change(profile[0], channel, 0.0, v, 0.0, 0.0, 40.0, 400.0)


def test_clear_leaves_an_accepted_profile_of_nothing():
    profile = change_of_velocity(0.0, 8.0, 0.0, 0.0)
    clear(profile, 17)
    p = profile[0]
    assert (p["start_tick"], p["valid"], p["duration_s"]) == (17, 1, 0.0)
    assert not p["segments"].any()
    assert math.isnan(p["reason_value"])


@kernel
def clear(profile, tick):
    profiles.clear(profile[0], tick)
