"""The sensor against vector algebra in three dimensions, and its readings against its data sheet."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.frames import SATURATED, VALID
from sim_backends.plant.sensor import bear

QUIET = {"force_noise_n": 0.0, "moment_noise_nmm": 0.0, "cross_axis_error": 0.0, "drift_per_min": [0.0] * 6}


def rotation_of_sensor_in_base(angle):
    """Columns: x_F = z_B, y_F against y of the gripper, z_F along its x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[0, s, c], [0, -c, s], [1, 0, 0]])


def test_the_axes_are_a_rotation():
    r = rotation_of_sensor_in_base(0.3)
    assert r.T @ r == pytest.approx(np.eye(3))
    assert np.linalg.det(r) == pytest.approx(1.0)


@settings(max_examples=40, deadline=None)
@given(angle=st.floats(-3, 3), fx=st.floats(-2, 2), fy=st.floats(-2, 2), mz=st.floats(-20, 20))
def test_load_is_the_touch_moved_to_the_sensor_plus_the_weight(sensor, angle, fx, fy, mz):
    bear(sensor, np.array([fx, fy, mz]), angle)
    r = rotation_of_sensor_in_base(angle)
    touch, weight = r.T @ [fx, fy, 0], r.T @ sensor["weight_in_base_n"]
    assert np.linalg.norm(weight) == pytest.approx(1.5)
    moment = r.T @ [0, 0, mz] + np.cross([0, 0, 60.0], touch) + np.cross(sensor["centre_of_mass_mm"], weight)
    assert sensor["load"] == pytest.approx(np.concatenate((touch + weight, moment)), abs=1e-9)


@pytest.fixture(scope="module")
def sensor():
    from sim_backends.plant.backend import PlantBackend

    backend = PlantBackend({}, period_s=0.001, seed=1)
    return backend.compiled().device[0]["sensor"]


def test_resistance_to_insertion_reads_as_a_negative_force_along_z(sensor):
    bear(sensor, np.zeros(3), 0.0)
    empty = sensor["load"].copy()
    bear(sensor, np.array([-0.2, 0.0, 0.0]), 0.0)
    assert (sensor["load"] - empty)[2] == pytest.approx(-0.2)


def test_noise_has_the_rms_of_the_data_sheet(drive):
    bench = drive()
    x = np.array([bench.run(1, power=0)["wrench_in_sensor"].copy() for _ in range(6000)])
    assert x[:, :3].std(axis=0) == pytest.approx([0.004] * 3, rel=0.05)
    assert x[:, 3:].std(axis=0) == pytest.approx([0.1] * 3, rel=0.05)
    assert abs(np.corrcoef(x[1:, 2], x[:-1, 2])[0, 1]) < 0.06


def test_without_load_the_sensor_reads_bias_and_weight(drive):
    bias = [0.1, -0.2, 0.3, 1.0, -2.0, 3.0]
    bench = drive({"sensor": {**QUIET, "weight_n": 0.0, "bias": bias}})
    assert bench.read()["wrench_in_sensor"] == pytest.approx(bias)


def test_the_bias_drifts_with_time_alone(drive):
    drift = [0.06, 0.0, -0.12, 1.0, 0.0, 0.0]
    bench = drive({"sensor": {**QUIET, "drift_per_min": drift}})
    start = bench.read()["wrench_in_sensor"].copy()
    later = bench.read(60_000)["wrench_in_sensor"]
    assert later - start == pytest.approx(drift, abs=1e-9)


def test_the_filter_follows_a_step_with_its_time_constant(drive):
    bench = drive({"sensor": {**QUIET, "weight_n": 0.0, "bias": [0.0] * 6, "cutoff_hz": 10.0}})
    bench.device["sensor"]["weight_in_base_n"] = (0.0, 0.0, 1.0)  # a weight is hung on
    tau_ticks = 1000 / (2 * np.pi * 10.0)
    after = bench.run(40, power=0)["wrench_in_sensor"][0]
    assert after == pytest.approx(1 - np.exp(-40 / tau_ticks), rel=1e-9)


@pytest.mark.parametrize(("bias_n", "validity"), [(17.0, VALID), (19.0, SATURATED)])
def test_beyond_the_rated_load_no_component_is_told(drive, bias_n, validity):
    bench = drive({"sensor": {**QUIET, "weight_n": 0.0, "bias": [bias_n, 0, 0, 0, 0, 0]}})
    frame = bench.read()
    assert frame["wrench_validity"] == validity
    assert np.isnan(frame["wrench_in_sensor"]).all() == (validity == SATURATED)
    assert frame["axes_validity"] == VALID


def test_cross_axis_error_is_small_and_belongs_to_the_seed(drive):
    matrices = [drive(seed=seed).device["sensor"]["matrix"] for seed in (1, 1, 2)]
    assert np.array_equal(matrices[0], matrices[1])
    assert not np.array_equal(matrices[0], matrices[2])
    force_to_force = matrices[0][:3, :3] - np.eye(3)
    assert 0 < np.abs(force_to_force).max() < 0.02
