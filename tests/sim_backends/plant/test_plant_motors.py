"""Motor and screw against the closed form of a first-order machine, and friction against what friction may do."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.errors import OptionError
from hal.options import read
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
        "gain_v_per_v",
        "resistance_ohm",
    ):
        m[name] = getattr(o, name)
    m["inductance_h"] = o.inductance_mh / 1000
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


def voltage_motor(**changes):
    """1 V/V, 5 ohm, 0.5 mH if nothing else is said."""
    return motor(**{"in_voltage_mode": 1, "gain_v_per_v": 1.0, "resistance_ohm": 5.0, "inductance_h": 5e-4} | changes)


def test_in_voltage_mode_the_back_emf_limits_the_speed():
    m = voltage_motor()
    spin(m, 0.6, command_v=4.0)
    k, r = m["torque_nmm_per_a"], m["resistance_ohm"]
    speed = (k * 4.0 / r - m["coulomb_nmm"]) / (m["viscous_nmm_s"] + k * k * 1e-3 / r)
    assert m["rate_rad_per_s"] == pytest.approx(speed, rel=1e-6)
    assert m["current_a"] == pytest.approx((4.0 - k * 1e-3 * speed) / r, rel=1e-6)


def test_the_current_of_a_locked_motor_rises_with_the_electrical_time_constant():
    m = voltage_motor()
    tau_s = float(m["inductance_h"] / m["resistance_ohm"])
    spin(m, tau_s, command_v=5.0, jammed=True, dt_s=tau_s / 1000)
    assert m["current_a"] == pytest.approx(5.0 / 5.0 * (1 - math.exp(-1)), rel=1e-3)
    spin(m, 50 * tau_s, command_v=5.0, jammed=True, dt_s=5e-4)
    assert m["current_a"] == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("inductance_h", [5e-4, 0.02])
def test_both_poles_of_a_voltage_driven_motor_show_in_its_step_response(inductance_h):
    """Linear machine: (I, w)' = A (I, w) + B u, whose solution is a matrix exponential."""
    m = voltage_motor(coulomb_nmm=0.0, inductance_h=inductance_h)
    k, r, j, b = (float(m[n]) for n in ("torque_nmm_per_a", "resistance_ohm", "inertia_nmm_s2", "viscous_nmm_s"))
    a = np.array([[-r / inductance_h, -k * 1e-3 / inductance_h], [k / j, -b / j]])
    rest = np.linalg.solve(a, [-3.0 / inductance_h, 0.0])
    values, vectors = np.linalg.eig(a)
    for seconds in (0.002, 0.01, 0.03):
        m["angle_rad"] = m["rate_rad_per_s"] = m["current_a"] = 0.0
        spin(m, seconds, command_v=3.0, dt_s=1e-6)
        expected = rest - (vectors @ (np.exp(values * seconds) * np.linalg.solve(vectors, rest))).real
        assert (m["current_a"], m["rate_rad_per_s"]) == pytest.approx(expected, rel=2e-3)


@settings(max_examples=40, deadline=None)
@given(
    inductance_h=st.floats(0, 1),
    resistance_ohm=st.floats(0.05, 1000),
    torque=st.floats(0.1, 1000),
    inertia=st.floats(1e-5, 1),
)
def test_no_motor_is_too_fast_for_the_step(inductance_h, resistance_ohm, torque, inertia):
    """Whatever the poles, energy falls after the terminals are shorted."""
    m = voltage_motor(
        inductance_h=inductance_h,
        resistance_ohm=resistance_ohm,
        torque_nmm_per_a=torque,
        inertia_nmm_s2=inertia,
        coulomb_nmm=0.0,
        rate_rad_per_s=100.0,
        current_limit_a=1e9,
    )
    energy = []
    for _ in range(200):
        energy.append(inductance_h * m["current_a"] ** 2 + 1e-3 * inertia * m["rate_rad_per_s"] ** 2)
        spin(m, 5e-4, command_v=0.0, dt_s=5e-4)
    assert all(after <= before * (1 + 1e-9) for before, after in itertools.pairwise(energy))


def test_the_current_limit_holds_in_voltage_mode_and_friction_too():
    m = voltage_motor(resistance_ohm=0.5)
    amplify(m, 10.0, True)
    turn(m, 0.0, False, 5e-4)
    turn(m, 0.0, False, 5e-4)
    assert m["current_a"] == 2.0
    held = voltage_motor()
    spin(held, 0.05, command_v=0.99 * held["coulomb_nmm"] / held["torque_nmm_per_a"] * held["resistance_ohm"])
    assert held["angle_rad"] == 0.0


def test_without_power_a_voltage_driven_motor_coasts():
    """An open circuit does not brake, shorted terminals do."""
    coasting, braked, free = voltage_motor(), voltage_motor(), motor()
    for m, powered in ((coasting, False), (braked, True), (free, False)):
        m["rate_rad_per_s"], m["current_a"] = 100.0, 0.5
        amplify(m, 0.0, powered)
        for _ in range(20):
            turn(m, 0.0, False, 5e-4)
    assert coasting["current_a"] == 0.0
    assert coasting["rate_rad_per_s"] == free["rate_rad_per_s"]
    assert braked["rate_rad_per_s"] < 0.7 * free["rate_rad_per_s"]


@pytest.mark.parametrize("key", ["resistance_ohm", "inductance_mh", "gain_v_per_v"])
def test_impossible_motors_are_refused(key):
    with pytest.raises(OptionError, match=key):
        read(Motor, {key: -1.0})


def test_only_known_amplifiers_are_taken():
    with pytest.raises(OptionError, match=r"current \| voltage"):
        read(Motor, {"amplifier": "pwm"})


def test_a_bench_with_voltage_amplifiers_runs_at_their_speed(drive):
    bench = drive({"motor": {"amplifier": "voltage"}})
    bench.run(300, 2.0)
    free = (20.0 * 2.4 * 2.0 / 12.0 - 0.4) / (0.06 + 20.0**2 * 1e-3 / 12.0)
    assert (0.5 * free < bench.truth["motor_rate_rad_per_s"][:3]).all()
    assert (bench.truth["motor_rate_rad_per_s"][:3] < free).all()
    bench.run(300, 0.0, power=0)
    assert not bench.truth["motor_rate_rad_per_s"].any()
    assert not bench.truth["motor_current_a"].any()
