"""Motor and screw against the closed form of a first-order machine, and friction against what friction may do."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_backends.plant.motors import MOTOR, amplify, encoder_angle, turn
from sim_backends.plant.options import Motor

DT_S = 1e-5


def motor(**changes):
    o = Motor()
    m = np.zeros(1, MOTOR)[0]
    for name in (
        "gain_a_per_v",
        "current_limit_a",
        "torque_nmm_per_a",
        "inertia_nmm_s2",
        "viscous_nmm_s",
        "coulomb_nmm",
    ):
        m[name] = getattr(o, name)
    m["screw_loss"] = 1 / o.screw_efficiency - 1
    m["count_rad"] = 2 * math.pi / o.counts_per_turn
    m["low_rad"], m["high_rad"], m["lead_mm_per_rad"] = -1e6, 1e6, 0.097
    for name, value in changes.items():
        m[name] = value
    return m


def spin(m, seconds, command_v=0.0, load_n=0.0, jammed=False, dt_s=DT_S):
    amplify(m, command_v, True)
    for _ in range(round(seconds / dt_s)):
        turn(m, load_n, jammed, dt_s)


def test_free_run_reaches_the_speed_where_drag_and_friction_eat_the_torque():
    m = motor()
    spin(m, 0.4, command_v=2.0)
    torque = m["torque_nmm_per_a"] * m["gain_a_per_v"] * 2.0
    assert m["rate_rad_per_s"] == pytest.approx((torque - m["coulomb_nmm"]) / m["viscous_nmm_s"], rel=1e-6)


@pytest.mark.parametrize(("dt_s", "tolerance"), [(DT_S, 1e-3), (5e-4, 0.03)])
def test_speed_rises_with_the_mechanical_time_constant(dt_s, tolerance):
    m = motor()
    tau_s = m["inertia_nmm_s2"] / m["viscous_nmm_s"]
    final = (m["torque_nmm_per_a"] * m["gain_a_per_v"] * 3.0 - m["coulomb_nmm"]) / m["viscous_nmm_s"]
    spin(m, tau_s, command_v=3.0, dt_s=dt_s)
    assert m["rate_rad_per_s"] == pytest.approx(final * (1 - math.exp(-1)), rel=tolerance)


def test_current_is_limited_and_gone_without_power():
    m = motor(current_limit_a=0.5)
    amplify(m, -10.0, True)
    assert m["current_a"] == -0.5
    amplify(m, -10.0, False)
    assert m["current_a"] == 0.0


def test_friction_holds_below_breakaway_to_the_last_bit():
    m = motor()
    breakaway_v = m["coulomb_nmm"] / (m["torque_nmm_per_a"] * m["gain_a_per_v"])
    spin(m, 0.05, command_v=0.99 * breakaway_v)
    assert m["angle_rad"] == 0.0
    spin(m, 0.05, command_v=1.05 * breakaway_v)
    assert m["angle_rad"] > 0.0


def test_coasting_ends_at_rest_without_turning_back():
    m = motor(rate_rad_per_s=150.0)
    rates = []
    for _ in range(1000):
        turn(m, 0.0, False, 5e-4)
        rates.append(float(m["rate_rad_per_s"]))
    assert min(rates) == 0.0
    assert rates[-1] == 0.0
    assert all(a >= b for a, b in itertools.pairwise(rates))


@pytest.mark.parametrize(("efficiency", "holds"), [(0.35, True), (0.8, False)])
def test_only_an_efficient_screw_is_driven_back_by_its_load(efficiency, holds):
    m = motor(screw_loss=1 / efficiency - 1)
    spin(m, 0.1, load_n=-40.0)
    assert bool(m["angle_rad"] == 0.0) is holds


def test_driving_against_a_load_costs_the_efficiency():
    against, free = motor(), motor()
    spin(against, 0.4, command_v=5.0, load_n=-10.0)
    spin(free, 0.4, command_v=5.0)
    lost = (free["rate_rad_per_s"] - against["rate_rad_per_s"]) * against["viscous_nmm_s"]
    assert lost == pytest.approx(0.097 * 10.0 / Motor().screw_efficiency, rel=1e-6)


def test_stops_and_jams_hold_against_full_torque():
    m = motor(low_rad=-0.5, high_rad=0.7)
    spin(m, 0.1, command_v=10.0)
    assert (m["angle_rad"], m["rate_rad_per_s"]) == (0.7, 0.0)
    spin(m, 0.1, command_v=-10.0)
    assert (m["angle_rad"], m["rate_rad_per_s"]) == (-0.5, 0.0)
    spin(m, 0.1, command_v=10.0, jammed=True)
    assert m["angle_rad"] == -0.5


@settings(max_examples=50, deadline=None)
@given(angle=st.floats(-500, 500), zero=st.floats(-500, 500))
def test_the_encoder_counts_whole_steps_from_its_zero(angle, zero):
    m = motor(angle_rad=angle, zero_rad=zero)
    seen, step = encoder_angle(m), float(m["count_rad"])
    assert abs(seen - (angle - zero)) <= step / 2 * (1 + 1e-9)
    assert seen / step == pytest.approx(round(seen / step), abs=1e-6)
