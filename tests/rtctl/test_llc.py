"""Low-level control: backlash against a play operator, PID, limits, bumpless rest."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.kernel import kernel
from rtctl import llc
from rtctl.memory import parameters_dtype, state_dtype

PERIOD = 0.001
CHI = 2.0


def make(**values):
    p, s = np.zeros(1, parameters_dtype(3)), np.zeros(1, state_dtype(3))
    defaults = {
        "period_s": PERIOD, "backlash_rad": CHI, "backlash_step_rad": 0.04, "proportional": 1.0, "integral": 5.0,
        "derivative": 0.0, "feedforward": 0.0, "derivative_blend": 0.4, "integral_limit_v": 3.0,
        "command_limit_v": 8.0, "command_slew_v": 2.0,
    }  # fmt: skip
    for name, value in {**defaults, **values}.items():
        p[name] = value
    return p, s


@kernel
def follow(p, s, references, motors):
    for k in range(references.shape[0]):
        motors[k] = llc.compensate_backlash(p[0], s[0], 0, references[k])


@kernel
def regulate(p, s, reference, angle, limit_v):
    return llc.pid(p[0], s[0], 0, reference, angle, limit_v)


@kernel
def clamp(p, s, command, limit_v):
    applied = llc.limit(p[0], s[0], 0, command, limit_v)
    if math.isfinite(applied):
        s[0].last_command_v[0] = applied
    return applied


@kernel
def come_to_rest(s, angle):
    llc.rest(s[0], 0, angle)


def play(motors, width):
    """The piston of a play operator: the motor pushes it at either side of a gap of `width`; starts at the low side."""
    piston, at = [], 0.0
    for m in motors:
        at = min(max(at, m - width), m)
        piston.append(at)
    return np.array(piston)


def followed(references, **values):
    p, s = make(**values)
    motors = np.empty(len(references))
    follow(p, s, np.asarray(references, dtype=float), motors)
    return motors


def wave(cycles=3, n=6000):
    return 40.0 * (1.0 - np.cos(np.linspace(0.0, 2 * math.pi * cycles, n)))


def test_compensated_following_has_no_dead_zone():
    references = wave()
    dead = play(references, CHI) - references
    piston = play(followed(references), CHI)
    assert np.abs(dead).max() > 0.9 * CHI, "without compensation the piston lags by the play"
    error = np.abs(piston - references)
    turning = math.ceil(CHI / 0.04) + 1  # ticks the change of sides takes
    turns = np.flatnonzero(np.diff(np.sign(np.diff(references)))) + 1
    near_turn = np.zeros(len(references), bool)
    for t in [0, *turns]:
        near_turn[t : t + turning + 1] = True
    assert error[~near_turn].max() < 1e-9
    assert error.max() < 0.7, "while it changes sides it is late by what the reference moves meanwhile"


def test_the_compensation_changes_sides_without_a_step():
    references = np.concatenate((np.linspace(0, 10, 500), np.linspace(10, 0, 500)))
    motors = followed(references)
    assert np.abs(np.diff(motors)).max() <= 0.04 + 10 / 499 + 1e-12
    assert motors[499] == pytest.approx(10 + CHI)
    assert motors[-1] == pytest.approx(0.0)


def test_a_resting_reference_keeps_its_side():
    references = np.concatenate((np.linspace(0, 5, 200), np.full(300, 5.0), np.linspace(5, 6, 50)))
    motors = followed(references)
    assert motors[200:500] == pytest.approx(5.0 + CHI)
    assert motors[-1] == pytest.approx(6.0 + CHI)


def test_rounding_does_not_change_sides():
    rng = np.random.default_rng(0)
    references = np.concatenate((np.linspace(0, 5, 200), 5.0 + rng.uniform(-3e-10, 3e-10, 300)))
    assert followed(references)[300:] == pytest.approx(5.0 + CHI, abs=1e-8)


@given(st.lists(st.floats(-0.5, 0.5), min_size=5, max_size=200))
def test_the_piston_is_never_farther_than_the_play_from_its_reference(moves):
    references = np.cumsum(moves)
    piston = play(followed(references), CHI)
    assert np.abs(piston - references).max() <= CHI + 1e-9


def test_the_integral_stops_where_the_command_is_at_its_limit():
    p, s = make(proportional=1.0, integral=50.0, integral_limit_v=100.0)
    for _ in range(2000):
        regulate(p, s, 10.0, 0.0, 2.0)
    assert abs(s["integral_v"][0, 0]) <= 2.0, "no more than could be applied"
    p, s = make(proportional=0.0, integral=50.0, integral_limit_v=1.5)
    for _ in range(2000):
        regulate(p, s, 1.0, 0.0, 8.0)
    assert s["integral_v"][0, 0] == pytest.approx(1.5)


def test_a_saturated_integral_unwinds_as_soon_as_the_error_turns():
    p, s = make(integral=50.0, integral_limit_v=3.0)
    for _ in range(1000):
        regulate(p, s, 1.0, 0.0, 3.0)
    before = s["integral_v"][0, 0]
    assert before > 1.9
    regulate(p, s, -50.0, 0.0, 3.0)
    assert s["integral_v"][0, 0] < before


def test_pid_in_closed_form_on_a_ramp_of_error():
    p, s = make(proportional=2.0, integral=3.0, derivative=0.5, derivative_blend=1.0, feedforward=0.25)
    commands = [regulate(p, s, 0.01 * k, 0.0, 1e9) for k in range(1, 6)]
    expected = [2.0 * 0.01 * k + 3.0 * PERIOD * 0.01 * k * (k + 1) / 2 + 0.5 * 10.0 + 0.25 * 10.0 for k in range(1, 6)]
    assert commands == pytest.approx(expected)


def test_the_rate_is_filtered_to_first_order():
    p, s = make(proportional=0.0, integral=0.0, derivative=1.0, derivative_blend=0.25)
    commands = [regulate(p, s, 0.001 * k, 0.0, 1e9) for k in range(1, 20)]
    assert commands == pytest.approx([1.0 - 0.75**k for k in range(1, 20)])


@given(st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=60), st.floats(0.1, 10.0))
def test_an_applied_command_keeps_amplitude_and_slew(commands, limit_v):
    p, s = make()
    last = 0.0
    for command in commands:
        applied = clamp(p, s, command, limit_v)
        assert abs(applied) <= limit_v + 1e-12
        assert abs(applied - last) <= 2.0 + 1e-12
        last = applied


def test_limits_are_taken_against_the_previous_command():
    p, s = make()
    assert clamp(p, s, 100.0, 8.0) == 2.0
    assert clamp(p, s, 100.0, 8.0) == 4.0
    assert clamp(p, s, -100.0, 8.0) == 2.0


def test_what_is_not_a_number_passes_so_that_it_is_seen():
    p, s = make()
    assert math.isnan(clamp(p, s, math.nan, 8.0))
    assert math.isnan(regulate(p, s, math.nan, 0.0, 8.0))
    assert math.isnan(regulate(*make(), 0.0, math.nan, 8.0))


@given(angle=st.floats(-400.0, 400.0), side=st.sampled_from([0.0, 1.0]))
def test_coming_to_rest_leaves_nothing_to_do(angle, side):
    p, s = make(derivative=0.1, feedforward=0.1)
    s["side"][0, 0], s["compensation_rad"][0, 0] = side, side * CHI
    s["integral_v"][0, 0], s["rate_rad_per_s"][0, 0] = 2.0, 30.0
    come_to_rest(s, angle)
    motors = np.empty(1)
    follow(p, s, np.array([angle - side * CHI]), motors)
    assert motors[0] == pytest.approx(angle)
    assert regulate(p, s, motors[0], angle, 8.0) == pytest.approx(0.0, abs=1e-9)
