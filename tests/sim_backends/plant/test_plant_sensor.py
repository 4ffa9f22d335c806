"""The sensor against vector algebra in three dimensions, and its readings against its data sheet."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.frames import SATURATED, VALID
from sim_backends.plant.backend import PlantBackend
from sim_backends.plant.sensor import bear, stand, swing

QUIET = {
    "force_noise_n": 0.0,
    "moment_noise_nmm": 0.0,
    "force_step_n": 0.0,
    "moment_step_nmm": 0.0,
    "cross_axis_error": 0.0,
    "drift_per_min": [0.0] * 6,
}
PERIOD_S = 0.001
LEVER_MM, CENTRE_MM, WEIGHT_N, INERTIA_KG_MM2 = 60.0, np.array([3.0, -2.0, 25.0]), 1.5, 150.0


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
    bear(sensor, np.array([fx, fy, mz]), angle, 0.0, 0.0, 0.0)
    r = rotation_of_sensor_in_base(angle)
    touch, weight = r.T @ [fx, fy, 0], r.T @ sensor["weight_in_base_n"]
    assert np.linalg.norm(weight) == pytest.approx(1.5)
    moment = r.T @ [0, 0, mz] + np.cross([0, 0, 60.0], touch) + np.cross(sensor["centre_of_mass_mm"], weight)
    assert sensor["load"] == pytest.approx(np.concatenate((touch + weight, moment)), abs=1e-9)


@pytest.fixture(scope="module")
def sensor():
    backend = PlantBackend({}, period_s=0.001, seed=1)
    return backend.compiled().device[0]["sensor"]


def test_resistance_to_insertion_reads_as_a_negative_force_along_z(sensor):
    bear(sensor, np.zeros(3), 0.0, 0.0, 0.0, 0.0)
    empty = sensor["load"].copy()
    bear(sensor, np.array([-0.2, 0.0, 0.0]), 0.0, 0.0, 0.0, 0.0)
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


def inertia_of(sensor, poses):
    """Loads (n, 6) that the module's motion alone puts on the sensor, one for each pose after the first."""
    stand(sensor, poses[0])
    loads = []
    for pose in poses[1:]:
        swing(sensor, pose, PERIOD_S)
        bear(sensor, np.zeros(3), pose[2], 0.0, 0.0, 0.0)
        moved = sensor["load"].copy()
        kept = sensor["acceleration"].copy()
        sensor["acceleration"] = 0.0
        bear(sensor, np.zeros(3), pose[2], 0.0, 0.0, 0.0)
        sensor["acceleration"] = kept
        loads.append(moved - sensor["load"])
    sensor["acceleration"] = 0.0
    return np.array(loads)


def test_a_constant_acceleration_reads_as_mass_times_acceleration(sensor):
    """2 m/s^2 along the axis, 1 m/s^2 to the left of it: 0.153 kg resist, at the centre of mass."""
    t = PERIOD_S * np.arange(20)
    angle = 0.3
    along, left = 2000.0, 1000.0
    c, s = np.cos(angle), np.sin(angle)
    way = np.stack([(c * along - s * left) * t**2 / 2, (s * along + c * left) * t**2 / 2, np.full_like(t, 0.0)], 1)
    loads = inertia_of(sensor, way + np.array([150.0, 3.0, angle]))
    mass = WEIGHT_N / 9.81
    force = -mass * np.array([0.0, -left, along]) / 1000  # y of {F} is against y of the gripper
    assert not loads[0].any()  # one difference is a speed
    assert loads[5] == pytest.approx(np.concatenate((force, np.cross(CENTRE_MM, force))), abs=1e-4)


def test_a_turn_about_the_sensor_reads_as_centripetal_force(sensor):
    """Constant speed about the sensor's origin: m w^2 towards it holds the module, which pulls outwards."""
    rate = 5.0
    angle = rate * PERIOD_S * np.arange(12)
    poses = np.stack([LEVER_MM * np.cos(angle), LEVER_MM * np.sin(angle), angle], 1)
    load = inertia_of(sensor, poses)[-1]
    in_plane = np.array([0.0, CENTRE_MM[1], CENTRE_MM[2]])
    force = WEIGHT_N / 9.81 * rate**2 * in_plane / 1000
    moment = np.cross(CENTRE_MM, force)
    late = rate * PERIOD_S * np.linalg.norm(force)  # the acceleration is that of a tick ago
    assert load[:3] == pytest.approx(force, abs=1.01 * late)
    assert load[3:] == pytest.approx(moment, abs=1.01 * late * np.linalg.norm(CENTRE_MM))
    assert np.linalg.norm(load[:3]) == pytest.approx(np.linalg.norm(force), rel=1e-4)


def test_an_angular_acceleration_meets_the_moment_of_inertia_about_the_sensor(sensor):
    """From rest about the sensor's origin: Steiner's I + m r^2 times alpha."""
    alpha = 20.0
    angle = alpha * (PERIOD_S * np.arange(5)) ** 2 / 2
    poses = np.stack([LEVER_MM * np.cos(angle), LEVER_MM * np.sin(angle), angle], 1)
    load = inertia_of(sensor, poses)[-1]
    whole = INERTIA_KG_MM2 + WEIGHT_N / 9.81 * (2.0**2 + 25.0**2)
    assert load[3] == pytest.approx(-whole * alpha / 1000, rel=1e-3)


def test_a_module_that_moves_steadily_or_not_at_all_weighs_and_nothing_more(sensor):
    steady = np.array([150.0, 1.0, 0.1]) + np.outer(np.arange(10), [0.01, -0.02, 0.0])
    assert inertia_of(sensor, steady) == pytest.approx(0.0, abs=1e-6)
    assert not inertia_of(sensor, np.repeat(steady[:1], 10, 0)).any()


def test_on_the_bench_inertia_shows_while_the_robot_speeds_up_and_only_then(drive):
    """The reading less the weight is - m a of the true motion, as its second differences have it."""
    table = {"sensor": {**QUIET, "bias": [0.0] * 6, "cutoff_hz": 10000.0, "gravity_direction_in_base": [0, 0, -1]}}
    bench = drive(table)
    centre, read, angle = [], [], []
    for k in range(400):
        read.append(bench.run(1, 3.0 if k < 200 else 0.0)["wrench_in_sensor"].copy())
        x, y, phi = bench.truth["pose_gripper_in_base"]
        tip_in_sensor = np.array([0.0, 0.0, LEVER_MM])
        offset = rotation_of_sensor_in_base(phi) @ (CENTRE_MM - tip_in_sensor)
        centre.append(np.array([x, y, 0.0]) + offset)
        angle.append(phi)
    acceleration = np.diff(centre, 2, axis=0) / PERIOD_S**2
    force = [
        -rotation_of_sensor_in_base(p).T @ a * WEIGHT_N / 9.81 / 1000
        for p, a in zip(angle[2:], acceleration, strict=True)
    ]
    assert np.abs(force).max() > 0.05
    assert np.array(read)[2:, 1:3] == pytest.approx(np.array(force)[:, 1:3], abs=1e-6)
    assert read[-1][1:3] == pytest.approx(0.0, abs=1e-9)


def test_a_new_session_does_not_take_the_last_motion_for_a_blow(drive):
    bench = drive({"sensor": {**QUIET, "bias": [0.0] * 6, "cutoff_hz": 10000.0}})
    bench.run(300, 3.0)
    resting = bench.run(300, 0.0)["wrench_in_sensor"].copy()
    bench.run(300, 3.0)
    bench.backend.close()
    bench.backend.open()
    bench.read(bench.tick + 1)
    for _ in range(5):
        reading = bench.read(bench.tick + 1)["wrench_in_sensor"]
        assert np.abs(reading - resting)[:3].max() < 0.3


def test_after_a_rest_that_was_skipped_the_module_is_at_rest(drive):
    bench = drive({"sensor": {**QUIET, "bias": [0.0] * 6}})
    bench.run(200, 3.0)
    bench.run(400, 0.0, power=0)
    resting = bench.sensors["wrench_in_sensor"].copy()
    bench.read(bench.tick + 10**7)
    assert bench.read(bench.tick + 1)["wrench_in_sensor"] == pytest.approx(resting[0], abs=1e-9)


def test_readings_come_in_steps_of_the_converter(drive):
    step = {"force_step_n": 0.01, "moment_step_nmm": 0.5}
    bench = drive({"sensor": step})
    x = np.array([bench.run(1, power=0)["wrench_in_sensor"].copy() for _ in range(100)]) / np.repeat([0.01, 0.5], 3)
    assert x == pytest.approx(np.round(x), abs=1e-6)
    assert (np.ptp(x, axis=0) > 0).all()
    fine = drive({"sensor": {"force_step_n": 0.0, "moment_step_nmm": 0.0}})
    y = np.array([fine.run(1, power=0)["wrench_in_sensor"].copy() for _ in range(100)]) / np.repeat([0.01, 0.5], 3)
    assert np.abs(x - y).max() <= 0.5 + 1e-9
