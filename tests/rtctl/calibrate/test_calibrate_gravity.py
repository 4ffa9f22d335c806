"""Gravity and bias against 05 section 1: exact recovery, the residual table, the planar mechanism, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rtctl.calibrate.errors import CalibrationError
from rtctl.calibrate.gravity import fit_forces, fit_moments, fit_sphere, moment_matrix

SENSOR_AXES = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
NOISE_N = 0.004


def cone(rng, n, degrees):
    """Rotations (n, 3, 3) with rotation vectors uniform in a ball; of every kind for 180 degrees."""
    if degrees == 180:
        return Rotation.random(n, rng=rng).as_matrix()
    axis = rng.normal(size=(n, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    return Rotation.from_rotvec(axis * np.radians(degrees) * rng.random((n, 1)) ** (1 / 3)).as_matrix()


def planar(phi):
    """^F R_B of the planar robot at the platform angles phi (n,)."""
    return np.array([SENSOR_AXES @ Rotation.from_euler("z", p).as_matrix().T for p in phi])


def truth(rng, weight_n=2.0, bias_n=1.5):
    gravity, bias = rng.normal(size=3), rng.normal(size=3)
    return weight_n * gravity / np.linalg.norm(gravity), bias_n * bias / np.linalg.norm(bias)


@given(seed=st.integers(0, 10_000), degrees=st.sampled_from([20, 45, 180]), n=st.integers(6, 20))
def test_without_noise_every_fit_is_exact(seed, degrees, n):
    rng = np.random.default_rng(seed)
    gravity, bias = truth(rng)
    centre, moment_bias = rng.normal(0, 30, 3), rng.normal(0, 10, 3)
    turns = cone(rng, n, degrees)
    weight = turns @ gravity
    linear = fit_forces(turns, weight + bias)
    assert linear.free.shape == (0, 6)
    assert np.concatenate((linear.gravity_force_in_base_n - gravity, linear.bias_in_sensor_n - bias)) == pytest.approx(0, abs=1e-9)  # fmt: skip
    sphere = fit_sphere(turns, weight + bias)
    assert np.concatenate((sphere.gravity_force_in_base_n - gravity, sphere.bias_in_sensor_n - bias)) == pytest.approx(0, abs=1e-9)  # fmt: skip
    moments = fit_moments(linear.predict(turns) - linear.bias_in_sensor_n, np.cross(centre, weight) + moment_bias)
    assert moments.free.shape == (0, 6)
    assert moments.centre_of_mass_in_sensor_mm == pytest.approx(centre, abs=1e-8)
    assert moments.bias_in_sensor_nmm == pytest.approx(moment_bias, abs=1e-8)
    assert moments.predict(weight) == pytest.approx(np.cross(centre, weight) + moment_bias, abs=1e-8)


def residual_95(n, degrees, trials=400, angle_error_deg=0.0, noise_n=NOISE_N):
    """95th percentile of the residual force [N] on new poses of the sphere fit and of the linear fit."""
    rng = np.random.default_rng(20)
    left: tuple[list, list] = ([], [])
    for _ in range(trials):
        gravity, bias = truth(rng)
        told, new = cone(rng, n, degrees), cone(rng, 40, degrees)

        def readings(turns, rng=rng, gravity=gravity, bias=bias):
            tilt = Rotation.from_rotvec(np.radians(angle_error_deg) * rng.normal(size=(len(turns), 3))).as_matrix()
            return (tilt @ turns) @ gravity + bias

        force = readings(told) + rng.normal(0, noise_n, (n, 3))
        expected = readings(new)
        for kind, fit in enumerate((fit_sphere, fit_forces)):
            left[kind].append(np.linalg.norm(fit(told, force).predict(new) - expected, axis=1))
    return [float(np.percentile(np.concatenate(kind), 95)) for kind in left]


@pytest.mark.parametrize(
    ("degrees", "n", "sphere", "linear"),
    [(20, 6, 0.130, 0.0079), (20, 10, 0.048, 0.0058), (20, 20, 0.033, 0.0037), (20, 50, 0.021, 0.0025),
     (180, 6, 0.021, 0.0083), (180, 10, 0.010, 0.0052), (180, 20, 0.006, 0.0035), (180, 50, 0.0035, 0.0023)],
)  # fmt: skip
def test_residuals_of_the_table(degrees, n, sphere, linear):
    assert residual_95(n, degrees) == pytest.approx([sphere, linear], rel=0.25)


def test_the_sphere_fit_needs_ten_poses_at_45_degrees():
    assert residual_95(10, 45)[0] < 0.03


@pytest.mark.parametrize(("degrees", "left_n"), [(0.1, 0.0095), (0.5, 0.0445)])
def test_what_the_bound_really_is_orientation_error(degrees, left_n):
    assert residual_95(20, 20, angle_error_deg=degrees)[1] == pytest.approx(left_n, rel=0.25)


def test_raw_readings_would_give_the_wrong_direction_of_gravity():
    """(A.7) as printed: the mean of the readings turned to {O}, bias included."""
    rng = np.random.default_rng(3)
    gravity, bias = truth(rng)
    turns = cone(rng, 20, 20)
    readings = turns @ gravity + bias
    raw = np.einsum("kji,kj->i", turns, readings)
    fitted = fit_sphere(turns, readings).gravity_force_in_base_n
    off = [np.degrees(np.arccos(min(v @ gravity / np.linalg.norm(v) / 2.0, 1.0))) for v in (raw, fitted)]
    assert off[0] > 20.0
    assert off[1] < 1e-4


class TestPlanar:
    """One axis of rotation: only b + f_g along it is identifiable, and that is all compensation needs."""

    phi = np.radians(np.linspace(-20, 20, 20))

    @pytest.mark.parametrize("gravity", [(0.0, -2.0, 0.0), (0.15, -0.45, -1.4), (0.0, 0.0, -2.0)])
    def test_the_sum_along_the_axis_is_known_and_new_poses_are_predicted(self, gravity):
        gravity, bias = np.array(gravity), np.array([0.35, -0.2, 0.8])
        turns = planar(self.phi)
        fit = fit_forces(turns, turns @ gravity + bias)
        assert len(fit.free) == 1
        free = fit.free[0] * np.sign(fit.free[0, 2])
        assert free == pytest.approx(np.array([0, 0, 1, -1, 0, 0]) / np.sqrt(2), abs=1e-9)  # z_B is x_F
        assert fit.gravity_force_in_base_n[:2] == pytest.approx(gravity[:2], abs=1e-9)
        assert fit.bias_in_sensor_n[1:] == pytest.approx(bias[1:], abs=1e-9)
        both = fit.gravity_force_in_base_n[2], fit.bias_in_sensor_n[0]
        assert both == pytest.approx([(gravity[2] + bias[0]) / 2] * 2, abs=1e-9)  # of all solutions the shortest
        new = planar(np.radians([-35.0, 1.0, 33.0]))
        assert fit.predict(new) == pytest.approx(new @ gravity + bias, abs=1e-9)

    def test_noise_leaves_three_millinewtons(self):
        rng = np.random.default_rng(7)
        gravity, bias = np.array([0.3, -1.9, -0.5]), np.array([0.35, -0.2, 0.8])
        left = []
        for _ in range(300):
            turns = planar(rng.uniform(-0.35, 0.35, 20))
            fit = fit_forces(turns, turns @ gravity + bias + rng.normal(0, NOISE_N, (20, 3)))
            new = planar(rng.uniform(-0.35, 0.35, 20))
            left.append(np.linalg.norm(fit.predict(new) - new @ gravity - bias, axis=1))
        assert np.percentile(left, 95) == pytest.approx(0.003, rel=0.25)

    @pytest.mark.parametrize(
        ("gravity", "rank"), [((0.0, -2.0, 0.0), 3), ((0.3, -1.9, -0.5), 3), ((0.0, 0.0, -2.0), 1)]
    )
    @pytest.mark.parametrize("noise_n", [0.0, NOISE_N])
    def test_the_sphere_fit_refuses(self, gravity, rank, noise_n):
        turns = planar(self.phi)
        readings = turns @ np.array(gravity) + [0.35, -0.2, 0.8]
        readings += np.random.default_rng(1).normal(0, noise_n, readings.shape) if noise_n else 0.0
        with pytest.raises(CalibrationError, match=f"no sphere.*rank {rank}.*rank 4.*linear fit"):
            fit_sphere(turns, readings, noise_n)

    def test_the_centre_of_mass_needs_gravity_across_the_axis(self):
        centre, bias = np.array([3.0, -2.0, 25.0]), np.array([4.0, -6.0, 2.0])
        turns = planar(self.phi)
        across, along = turns @ [0.0, -2.0, 0.0], turns @ [0.0, 0.0, -2.0]
        assert np.linalg.cond(moment_matrix(across)) == pytest.approx(123, rel=0.01)
        fit = fit_moments(across, np.cross(centre, across) + bias)
        assert len(fit.free) == 0
        assert fit.centre_of_mass_in_sensor_mm == pytest.approx(centre, abs=1e-9)
        assert np.linalg.matrix_rank(moment_matrix(along)) == 3
        fit = fit_moments(along, np.cross(centre, along) + bias)
        assert len(fit.free) == 3
        assert fit.predict(along) == pytest.approx(np.cross(centre, along) + bias, abs=1e-9)

    def test_a_wrong_share_of_the_weight_along_the_axis_moves_the_moment_bias_only(self):
        """Of minimum norm the weight along the axis is wrong, and the centre of mass is found all the same."""
        centre, bias = np.array([3.0, -2.0, 25.0]), np.array([4.0, -6.0, 2.0])
        turns = planar(self.phi)
        weight = turns @ [0.15, -0.45, -1.4]
        fit = fit_moments(turns @ [0.15, -0.45, -0.5], np.cross(centre, weight) + bias)
        assert fit.centre_of_mass_in_sensor_mm == pytest.approx(centre, abs=1e-9)
        assert fit.bias_in_sensor_nmm != pytest.approx(bias, abs=1.0)


def test_a_moment_fixed_in_the_base_would_be_wrong():
    """(III.57) lower block as printed: r x F is fixed in {F}, not in {B}; 05 section 1 finds tens of N mm left."""
    rng = np.random.default_rng(11)
    turns = Rotation.random(30, rng=rng).as_matrix()
    weight = turns @ [0.0, 0.0, -2.0]
    moments = np.cross([3.0, -2.0, 50.0], weight)
    printed = fit_forces(turns, moments).predict(turns) - moments
    assert np.linalg.norm(printed, axis=1).max() > 0.4 * np.linalg.norm(moments, axis=1).max()
    ours = fit_moments(weight, moments).predict(weight) - moments
    assert ours == pytest.approx(np.zeros_like(ours), abs=1e-9)


def test_an_angle_as_good_as_none_is_not_taken_for_one():
    """Half an arc minute about the other axes: the third part of gravity would be noise times thousands."""
    rng = np.random.default_rng(2)
    wobble = Rotation.from_rotvec(rng.normal(0, 1.5e-4, (20, 3)) * [1, 1, 0]).as_matrix()
    turns = planar(np.linspace(-0.3, 0.3, 20)) @ wobble
    gravity = np.array([0.15, -0.45, -1.4])
    fit = fit_forces(turns, turns @ gravity + rng.normal(0, NOISE_N, (20, 3)))
    assert len(fit.free) == 1
    assert np.abs(fit.gravity_force_in_base_n[:2] - gravity[:2]).max() < 0.02


@pytest.mark.parametrize(
    ("turns", "readings", "message"),
    [
        (planar([0.0, 0.1]), np.zeros((2, 3)), "too few poses.*2.*at least 3"),
        (planar([0.0, 0.1, 0.2]), np.zeros((2, 3)), "do not belong together"),
        (planar([0.0, 0.1, 0.2]), np.array([[0, 0, 1], [0, np.nan, 1], [0, 0, 1.0]]), "finite"),
        (2 * planar([0.0, 0.1, 0.2]), np.zeros((3, 3)), "orthonormal"),
        (np.zeros((3, 2)), np.zeros((3, 3)), r"rotation matrices.*\(n, 3, 3\)"),
    ],
)
def test_what_cannot_be_fitted_is_refused(turns, readings, message):
    with pytest.raises(CalibrationError, match=message):
        fit_forces(turns, readings)


def test_a_weightless_module_has_no_centre_of_mass():
    with pytest.raises(CalibrationError, match="nothing weighs"):
        fit_moments(np.zeros((4, 3)), np.ones((4, 3)))
