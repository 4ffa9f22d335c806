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
from rtctl.memory import WINDOW_MAX, parameters_dtype, state_dtype
from rtctl.parameters import butterworth_low_pass
from rtctl.record import controller_table

# {F} in terms of the gripper: x_F = gripper z, y_F = -gripper y, z_F = gripper x
SENSOR_AXES = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])


class Sensor:
    """The block with its memory; `feed` is one tick."""

    def __init__(self, cutoff_hz=8.0, force=(0.0, 0.0, 0.0), centre=(0.0, 0.0, 0.0), unbias_ticks=100, window=0):
        self.parameters, self.state = np.zeros(1, parameters_dtype(3)), np.zeros(1, state_dtype(3))
        self.sensors, self.record = np.zeros(1, sensor_frame(4)), np.zeros(1, controller_table(3).dtype)
        p = self.parameters[0]
        p["filter_b"], p["filter_a"] = butterworth_low_pass(cutoff_hz, 0.001)
        p["moving_average"], p["window_ticks"] = window > 0, max(window, 1)
        p["gravity_force_in_base_n"], p["centre_of_mass_in_sensor_mm"] = force, centre
        p["unbias_ticks"] = unbias_ticks
        self.state["rotation"][0] = np.eye(3)
        self.state["unbiased"] = 1

    def turn(self, rotation):
        self.state["rotation"][0] = rotation

    def unbias(self):
        self.state["unbiased"], self.state["unbias_left"] = 0, self.parameters["unbias_ticks"]
        self.state["unbias_sum"] = 0.0

    def swap(self, **changes):
        """Other parameters from the next tick on, as the tick takes them over."""
        staged = self.parameters.copy()
        for name, value in changes.items():
            staged[name] = value
        if is_other_filter(staged, self.parameters):
            self.state["filter_ready"] = 0
        self.parameters = staged

    def feed(self, reading, validity=VALID):
        self.sensors["wrench_in_sensor"], self.sensors["wrench_validity"] = reading, validity
        compensate(self.parameters, self.state, self.sensors, self.record)
        return self.record["wrench_in_base"][0].copy()


@kernel
def is_other_filter(a, b):
    return wrench.is_other_filter(a[0], b[0])


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


@pytest.mark.parametrize("window", [1, 2, 25, WINDOW_MAX])
def test_the_moving_average_is_the_mean_of_the_window_from_rest_at_the_first_sample(window):
    readings = np.random.default_rng(4).normal(1.0, 0.5, (3 * window + 10, 6))
    sensor = Sensor(window=window)
    got = np.array([sensor.feed(r) for r in readings])
    before = np.concatenate((np.repeat(readings[:1], window, axis=0), readings))
    expected = np.array([before[k + 1 : k + 1 + window].mean(axis=0) for k in range(len(readings))])
    assert got == pytest.approx(np.array([in_base(np.eye(3), f) for f in expected]), abs=1e-12)


def test_the_step_response_of_the_moving_average_is_a_ramp_of_25_ms():
    sensor = Sensor(window=25)
    sensor.feed(np.zeros(6))
    ramp = np.array([sensor.feed(np.ones(6))[0] for _ in range(40)])
    assert ramp == pytest.approx(np.minimum(np.arange(1, 41) / 25, 1.0), abs=1e-12)


def test_a_moving_average_does_not_remember_rounding():
    """Large readings come and go for a thousand windows; what is left of them afterwards is nothing, not 1e-10 N."""
    sensor = Sensor(window=25)
    for r in np.random.default_rng(5).normal(0.0, 1e6, (25_000, 6)):
        sensor.feed(r)
    for _ in range(2 * 25):
        left = sensor.feed(np.full(6, 1e-3))
    assert left == pytest.approx(in_base(np.eye(3), np.full(6, 1e-3)), rel=1e-12, abs=0)


FASTER = dict(zip(("filter_b", "filter_a"), butterworth_low_pass(40.0, 0.001), strict=True))


@pytest.mark.parametrize("changes", [{"moving_average": 1}, {"moving_average": 1, "window_ticks": 10}, FASTER])
def test_another_filter_begins_at_rest_at_its_first_sample(changes):
    sensor = Sensor()
    for _ in range(500):
        sensor.feed(np.zeros(6))
    sensor.swap(**changes)
    assert sensor.feed(np.ones(6)) == pytest.approx(in_base(np.eye(3), np.ones(6)), abs=1e-12)


def test_a_shorter_window_in_the_middle_of_a_lap_begins_anew():
    sensor = Sensor(window=50)
    for _ in range(30):
        sensor.feed(np.zeros(6))
    sensor.swap(window_ticks=5)
    assert [round(sensor.feed(np.full(6, v))[0], 12) for v in (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)] == [
        1,
        0.8,
        0.6,
        0.4,
        0.2,
        0,
    ]


def test_parameters_that_filter_alike_leave_the_memory_alone():
    sensor = Sensor(window=25)
    sensor.feed(np.zeros(6))
    sensor.swap(unbias_ticks=7)
    assert sensor.feed(np.ones(6))[0] == pytest.approx(1 / 25)


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


@pytest.mark.parametrize("window", [0, 7])
@pytest.mark.parametrize("validity", [INVALID, SATURATED])
def test_invalid_samples_give_no_force_and_leave_the_filter_alone(validity, window):
    sensor, undisturbed = Sensor(window=window), Sensor(window=window)
    readings = np.random.default_rng(1).normal(0, 1, (20, 6))
    for r in readings:
        sensor.feed(r)
        undisturbed.feed(r)
        assert np.isnan(sensor.feed(np.full(6, np.nan), validity)).all()
    assert sensor.feed(readings[0]) == pytest.approx(undisturbed.feed(readings[0]), abs=0)


@pytest.mark.parametrize("at", range(6))
@pytest.mark.parametrize("ready", [False, True])
@pytest.mark.parametrize("window", [0, 25])
def test_a_valid_sample_that_is_no_number_is_treated_as_invalid(at, ready, window):
    sensor = Sensor(window=window)
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
