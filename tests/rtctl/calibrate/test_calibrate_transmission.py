"""The fit of the wire drives against 05 section 4: exact without noise, within its bands with noise, refusals."""

import math

import numpy as np
import pytest

from rtctl import robots
from rtctl.calibrate.errors import CalibrationError
from rtctl.calibrate.transmission import LegFit, fit_leg, fit_legs
from rtctl.robots.planar_3rpr import load
from rtctl.settings import load as load_settings

CHI_1 = np.array([1.9, 2.4, 1.5])
ETA, RADIUS = 0.097, 2.0


def excitation():
    """Poses (300, 3) of 05 section 4."""
    k = np.arange(300)
    wave = 2 * np.pi * k / 300
    x, y = 162.5 + 7.5 * np.sin(7 * wave), 4 * np.sin(11 * wave + 0.7)
    return np.column_stack((x, y, np.radians(5.5 + 11.5 * np.sin(5 * wave + 1.9))))


def legs_of(robot, poses):
    """Strokes and turns from home (n, 3), from the equations (III.1)-(III.3) in vectors."""
    g = robot.record[0]

    def at(pose):
        c, s = math.cos(pose[2]), math.sin(pose[2])
        d = pose[:2] + g["platform_mm"] @ np.array([[c, s], [-s, c]]) - g["base_mm"]
        return np.linalg.norm(d, axis=1) - g["a_mm"], np.arctan2(d[:, 1], d[:, 0])

    strokes, bearings = zip(*map(at, poses), strict=True)
    return np.array(strokes), np.array(bearings) - at(robot.home_pose)[1]


def directions(strokes):
    """m_0 = 0, m_k = [q_k > q_k-1]."""
    return np.vstack((np.zeros(3, dtype=bool), strokes[1:] > strokes[:-1]))


@pytest.fixture(scope="module")
def bench():
    robot = load({})
    poses = excitation()
    strokes, turns = legs_of(robot, poses)
    side = directions(strokes)
    motor = strokes / ETA - RADIUS / ETA * turns - np.where(side, CHI_1, 0.0)
    return robot, poses, strokes, turns, motor, side


def test_without_noise_the_drives_come_out_to_ten_digits(bench):
    robot, poses, _, _, motor, side = bench
    for leg, chi_1 in zip(fit_legs(robot, poses, motor, side), CHI_1, strict=True):
        assert leg.eta_mm_per_rad == pytest.approx(ETA, abs=1e-10)
        assert leg.pulley_radius_mm == pytest.approx(RADIUS, abs=1e-10)
        assert leg.chi_rad == pytest.approx((0.0, chi_1), abs=1e-9)
        assert leg.backlash_rad == pytest.approx(-chi_1, abs=1e-9)
        assert leg.residual_rad < 1e-10


def test_with_noise_the_drives_come_out_within_the_bands(bench):
    """Noise of 0.3 rad, 0.03 mm and 0.5 mrad on theta, q and psi; 0.1 rad of backlash are two standard deviations."""
    _, _, strokes, turns, motor, side = bench
    legs: list[tuple[LegFit, float]] = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        q, psi, theta = (
            values + rng.normal(0, deviation, values.shape)
            for values, deviation in ((strokes, 0.03), (turns, 5e-4), (motor, 0.3))
        )
        legs += [(fit_leg(q[:, i], psi[:, i], theta[:, i], side[:, i]), CHI_1[i]) for i in range(3)]
    assert all(abs(leg.eta_mm_per_rad - ETA) < 2e-4 for leg, _ in legs)
    assert all(abs(leg.pulley_radius_mm - RADIUS) < 0.15 for leg, _ in legs)
    assert np.mean([abs(leg.backlash_rad + chi_1) < 0.1 for leg, chi_1 in legs]) >= 0.93
    assert np.mean([0.37 <= leg.residual_rad <= 0.46 for leg, _ in legs]) >= 0.93
    assert np.mean([leg.backlash_rad + chi_1 for leg, chi_1 in legs]) == pytest.approx(0.0, abs=0.01)


def test_the_standard_deviations_are_those_of_repeated_fits(bench):
    _, _, strokes, turns, motor, side = bench
    rng = np.random.default_rng(1)
    fits = [fit_leg(strokes[:, 1], turns[:, 1], motor[:, 1] + rng.normal(0, 0.4, 300), side[:, 1]) for _ in range(400)]
    for value, told in (
        ("eta_mm_per_rad", "eta_sd_mm_per_rad"),
        ("pulley_radius_mm", "pulley_radius_sd_mm"),
        ("backlash_rad", "backlash_sd_rad"),
    ):
        scatter = np.std([getattr(f, value) for f in fits])
        assert np.mean([getattr(f, told) for f in fits]) == pytest.approx(scatter, rel=0.15)


def test_a_lagging_piston_has_a_positive_backlash():
    """The motor leads by 1.8 rad when extending, which is what the controller adds."""
    leg = LegFit(0.097, 2.0, (0.9, -0.9), 0.0, 0.0, 0.0, 0.0)
    assert leg.backlash_rad == pytest.approx(1.8)


def changed(values, at, value):
    values = np.array(values, dtype=float)
    values[at] = value
    return values


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p, m, s: (changed(p, (3, 0), np.nan), m, s), "leg 1.*cannot reach"),
        (lambda p, m, s: (p, changed(m, (3, 2), np.inf), s), "leg 3.*not finite"),
        (lambda p, m, s: (p[:5], m[:5], s[:5]), "leg 1 has too few poses.*5.*at least 8"),
        (lambda p, m, s: (p, m, s | True), "leg 1 came too rarely from one side.*0.*at least 3"),
        (lambda p, m, s: (np.tile(p[0], (300, 1)), m, s), "do not determine the drive of leg 1"),
        (lambda p, m, s: (p, m[:10], s), "do not belong together"),
    ],
)
def test_what_cannot_be_fitted_is_refused(bench, change, message):
    robot, poses, _, _, motor, side = bench
    with pytest.raises(CalibrationError, match=message):
        fit_legs(robot, *change(poses, motor, side))


def test_the_settings_robot_can_be_fitted_too():
    settings = load_settings("planar-sim")
    robot = robots.load(settings.robot.kind, settings.robot.geometry)
    poses = excitation()
    strokes, turns = legs_of(robot, poses)
    side = directions(strokes)
    assert [leg.residual_rad < 1e-10 for leg in fit_legs(robot, poses, strokes / ETA - RADIUS / ETA * turns, side)]
