"""Force sensing against scipy's filter and the gravity model of 05 section 1."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import butter, lfilter, lfilter_zi
from scipy.spatial.transform import Rotation

from hal.frames import INVALID, SATURATED, VALID, sensor_frame
from hal.kernel import kernel
from rtctl import wrench
from rtctl.memory import parameters_dtype, state_dtype
from rtctl.parameters import butterworth_low_pass
from rtctl.record import controller_table

# {F} in terms of the gripper: x_F = gripper z, y_F = -gripper y, z_F = gripper x
SENSOR_AXES = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])


class Sensor:
    """The block with its memory; `feed` is one tick."""

    def __init__(self, cutoff_hz=8.0, force=(0.0, 0.0, 0.0), centre=(0.0, 0.0, 0.0), unbias_ticks=100):
        self.parameters, self.state = np.zeros(1, parameters_dtype(3)), np.zeros(1, state_dtype(3))
        self.sensors, self.record = np.zeros(1, sensor_frame(4)), np.zeros(1, controller_table(3).dtype)
        p = self.parameters[0]
        p["filter_b"], p["filter_a"] = butterworth_low_pass(cutoff_hz, 0.001)
        p["gravity_force_in_base_n"], p["centre_of_mass_in_sensor_mm"] = force, centre
        p["unbias_ticks"] = unbias_ticks
        self.state["rotation"][0] = np.eye(3)
        self.state["unbiased"] = 1

    def turn(self, rotation):
        self.state["rotation"][0] = rotation

    def unbias(self):
        self.state["unbiased"], self.state["unbias_left"] = 0, self.parameters["unbias_ticks"]
        self.state["unbias_sum"] = 0.0

    def feed(self, reading, validity=VALID):
        self.sensors["wrench_in_sensor"], self.sensors["wrench_validity"] = reading, validity
        compensate(self.parameters, self.state, self.sensors, self.record)
        return self.record["wrench_in_base"][0].copy()


@kernel
def compensate(parameters, state, sensors, record):
    wrench.compensate(parameters[0], state[0], sensors[0], record[0])


def in_base(rotation, wrench_in_sensor):
    """{F} -> {B} by matrices."""
    turn = rotation @ SENSOR_AXES.T
    return np.concatenate((turn @ wrench_in_sensor[:3], turn @ wrench_in_sensor[3:]))


@pytest.mark.parametrize("cutoff_hz", [2.0, 8.0, 60.0, 200.0])
def test_the_coefficients_are_those_of_scipy(cutoff_hz):
    b, a = butterworth_low_pass(cutoff_hz, 0.001)
    expected_b, expected_a = butter(2, cutoff_hz, fs=1000.0)
    assert b == pytest.approx(expected_b, rel=1e-12)
    assert a == pytest.approx(expected_a, rel=1e-12)


@pytest.mark.parametrize("cutoff_hz", [8.0, 60.0])
def test_the_filter_is_scipys_from_rest_at_the_first_sample(cutoff_hz):
    readings = np.random.default_rng(3).normal(1.0, 0.5, (300, 6))
    sensor = Sensor(cutoff_hz)
    got = np.array([sensor.feed(r) for r in readings])
    b, a = butter(2, cutoff_hz, fs=1000.0)
    filtered, _ = lfilter(b, a, readings, axis=0, zi=lfilter_zi(b, a)[:, None] * readings[0])
    assert got == pytest.approx(np.array([in_base(np.eye(3), f) for f in filtered]), abs=1e-12)


@given(seed=st.integers(0, 10_000))
def test_gravity_is_gone_in_every_orientation(seed):
    rng = np.random.default_rng(seed)
    force, centre = rng.normal(0, 2, 3), rng.normal(0, 30, 3)
    sensor = Sensor(force=force, centre=centre)
    rotation = Rotation.random(random_state=seed).as_matrix()
    sensor.turn(rotation)
    weight = SENSOR_AXES @ rotation.T @ force
    residual = sensor.feed(np.concatenate((weight, np.cross(centre, weight))))
    assert residual == pytest.approx(np.zeros(6), abs=1e-11)


@given(seed=st.integers(0, 10_000))
def test_what_touches_the_gripper_comes_out_in_the_base_frame(seed):
    rng = np.random.default_rng(seed)
    force, centre, touch = rng.normal(0, 2, 3), rng.normal(0, 30, 3), rng.normal(0, 1, 6)
    rotation = Rotation.random(random_state=seed).as_matrix()
    sensor = Sensor(force=force, centre=centre)
    sensor.turn(rotation)
    weight = SENSOR_AXES @ rotation.T @ force
    reading = np.concatenate((weight, np.cross(centre, weight))) + touch
    assert sensor.feed(reading) == pytest.approx(in_base(rotation, touch), abs=1e-11)


def test_resistance_is_a_negative_axial_force():
    sensor = Sensor()
    phi = 0.3
    c, s = math.cos(phi), math.sin(phi)
    sensor.turn([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    force = sensor.feed([0.0, 0.0, -0.2, 0.0, 0.0, 0.0])[:3]
    assert force == pytest.approx([-0.2 * c, -0.2 * s, 0.0])


def test_unbias_takes_the_mean_of_what_gravity_leaves():
    bias = np.array([0.3, -0.2, 0.8, 4.0, -6.0, 2.0])
    force, centre = np.array([0.1, -0.4, -1.4]), np.array([3.0, -2.0, 25.0])
    sensor = Sensor(cutoff_hz=200.0, force=force, centre=centre)
    sensor.unbias()
    weight = SENSOR_AXES @ force
    load = np.concatenate((weight, np.cross(centre, weight)))
    for k in range(100):
        unknown = np.isnan(sensor.feed(load + bias)).all()
        assert unknown == (k < 99), "no force before the bias is known"
    assert sensor.state["bias_in_sensor"][0] == pytest.approx(bias, abs=1e-9)
    turned = Rotation.from_euler("z", 0.2).as_matrix()
    sensor.turn(turned)
    weight = SENSOR_AXES @ turned.T @ force
    for _ in range(500):
        left = sensor.feed(np.concatenate((weight, np.cross(centre, weight))) + bias)
    assert left == pytest.approx(np.zeros(6), abs=1e-9)


@pytest.mark.parametrize("validity", [INVALID, SATURATED])
def test_invalid_samples_give_no_force_and_leave_the_filter_alone(validity):
    sensor, undisturbed = Sensor(), Sensor()
    readings = np.random.default_rng(1).normal(0, 1, (20, 6))
    for r in readings:
        sensor.feed(r)
        undisturbed.feed(r)
        assert np.isnan(sensor.feed(np.full(6, np.nan), validity)).all()
    assert sensor.feed(readings[0]) == pytest.approx(undisturbed.feed(readings[0]), abs=0)


@pytest.mark.parametrize("at", range(6))
@pytest.mark.parametrize("ready", [False, True])
def test_a_valid_sample_that_is_no_number_is_treated_as_invalid(at, ready):
    sensor = Sensor()
    if ready:
        sensor.feed(np.ones(6))
    bad = np.ones(6)
    bad[at] = np.nan if at % 2 else np.inf
    assert np.isnan(sensor.feed(bad)).all()
    assert sensor.feed(np.ones(6)) == pytest.approx(in_base(np.eye(3), np.ones(6)), abs=1e-12)


def test_an_invalid_sample_ends_unbiasing_without_a_bias():
    sensor = Sensor()
    sensor.feed(np.ones(6))
    sensor.unbias()
    sensor.feed(np.ones(6))
    sensor.feed(np.full(6, np.nan), INVALID)
    assert sensor.state["unbias_left"][0] == 0
    for _ in range(200):
        sensor.feed(np.ones(6))
    assert not sensor.state["unbiased"][0]
