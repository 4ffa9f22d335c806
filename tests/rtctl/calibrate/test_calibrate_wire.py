"""Wire stiffness and misalignment against 05 sections 2 and 3."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtctl.calibrate.errors import CalibrationError
from rtctl.calibrate.misalignment import stretch, travel_error_bound_mm, travel_error_mm, wire_length
from rtctl.calibrate.wire_stiffness import DECAY_PER_MM2, axial_rigidity_n, local_stiffness
from sim_backends.plant import transmission

Y = np.linspace(0, 2, 401)
T = 40 * (Y + 0.15 * (np.exp(-Y / 0.3) - 1))


def true_slope(y):
    return 40 * (1 - 0.5 * np.exp(-y / 0.3))


def test_slopes_of_05_section_2():
    assert local_stiffness(Y, T, [0.0, 1.0, 2.0]) == pytest.approx([28.1609, 39.1802, 39.9522], abs=5e-5)
    assert true_slope(np.array([0.0, 1.0, 2.0])) == pytest.approx([20, 39.2865, 39.9745], abs=5e-5)


def test_it_is_the_weighted_regression_by_matrices():
    rng = np.random.default_rng(1)
    y, t = rng.uniform(0, 3, 60), rng.normal(0, 10, 60)
    for at in (0.2, 1.5, 2.9):
        a, w = np.column_stack((np.ones(60), y)), np.diag(np.exp(-DECAY_PER_MM2 * (y - at) ** 2))
        expected = np.linalg.solve(a.T @ w @ a, a.T @ w @ t)[1]
        assert local_stiffness(y, t, at) == pytest.approx([expected], rel=1e-10)


@given(slope=st.floats(-100, 100), offset=st.floats(-1e3, 1e3), at=st.floats(0, 2))
def test_a_straight_line_has_its_slope_everywhere(slope, offset, at):
    assert local_stiffness(Y, offset + slope * Y, at) == pytest.approx([slope], abs=1e-7)


def test_noise_of_a_fifth_of_a_newton():
    """Error 0.20 N/mm rms over the interior, here half of the test; differences of neighbours have 27."""
    inside = Y[(Y >= 0.5) & (Y <= 1.5)]
    smooth, raw = [], []
    for seed in range(40):
        noisy = T + np.random.default_rng(seed).normal(0, 0.2, T.size)
        smooth.append(local_stiffness(Y, noisy, inside) - true_slope(inside))
        raw.append(np.gradient(noisy, Y) - true_slope(Y))
    assert np.sqrt(np.mean(np.square(smooth))) == pytest.approx(0.20, rel=0.25)
    assert np.sqrt(np.mean(np.square(raw))) == pytest.approx(27, rel=0.25)


def test_a_longer_specimen_of_the_same_rope_has_the_same_rigidity():
    assert axial_rigidity_n([32.0, 25.6], 100.0) == pytest.approx([3200, 2560])
    assert axial_rigidity_n(17.77777, 180.0) == pytest.approx(3200, rel=1e-4)


@pytest.mark.parametrize(
    ("y", "t", "at", "message"),
    [
        ([0, 1], [0, 1, 2], 0.5, "do not belong together"),
        ([0, 1, np.nan], [0, 1, 2], 0.5, "finite"),
        (Y, T, 4.0, r"too few samples.*4\.0"),
        ([], [], 0.0, "too few samples"),
        ([1.0, 1.0, 1.0], [1, 2, 3], 1.0, "same one"),
    ],
)
def test_samples_without_a_slope_are_refused(y, t, at, message):
    with pytest.raises(CalibrationError, match=message):
        local_stiffness(y, t, at)


@pytest.mark.parametrize(
    ("u", "n", "length"), [(8, 0.25, 8.003915519), (8, 0.5, 8.015691780), (10, 0.0, 10.0), (8, 0.0, 8.0)]
)
def test_lengths_of_05_section_3(u, n, length):
    assert wire_length(u, n, 2.0) == pytest.approx(length, abs=1e-9)


def test_stretch_of_05_section_3():
    assert stretch([4.0, 8.0, 25.0], 0.5, 2.0) == pytest.approx([1.007950, 1.001961, 1.000200], abs=1e-6)
    assert stretch(4.0, 0.8, 2.0) == pytest.approx(1.0205, abs=5e-5)  # u* = 2 r, n = 0.4 r


def test_where_the_error_stays_below_five_micrometres():
    """n = 0.5 mm, r = 2 mm: not at u* = 8 mm over long travels, but as 05 section 3 lists."""
    travel = np.linspace(0, 45, 901)
    assert travel_error_mm(8.0, [1.0, 20.0], 0.5, 2.0) == pytest.approx([-0.00176, -0.01123], abs=5e-6)
    assert -travel_error_mm(8.0, 45.0, 0.5, 2.0) == pytest.approx(0.0133, abs=5e-5)
    assert -travel_error_mm(30.0, 45.0, 0.5, 2.0) == pytest.approx(0.0025, abs=5e-5)
    for home, most, offset in ((18.0, 45.0, 0.5), (25.0, 1e6, 0.5), (8.0, 45.0, 0.25), (8.0, 3.5, 0.5)):
        assert np.abs(travel_error_mm(home, travel * most / 45, offset, 2.0)).max() < 0.00505
    assert np.abs(travel_error_mm(8.0, travel, 0.5, 2.0)).max() > 0.005


@given(u=st.floats(6, 60), n=st.floats(-2, 2), r=st.floats(0.5, 2.5), travel=st.floats(0, 45))
def test_it_is_what_the_plant_pays_out_and_within_its_bound(u, n, r, travel):
    """The plant has its own implementation, by the point of contact."""
    assert wire_length(u, n, r) == pytest.approx(transmission.wire_length(u, n, r)[0], abs=1e-11)
    error = float(travel_error_mm(u, travel, n, r))
    assert error <= 1e-12
    first_order = n**2 / 2 * (1 / (u + travel) - 1 / u)
    assert error == pytest.approx(first_order, abs=2.0 * (abs(n) + r) * n**2 * r / u**3 + 1e-12)
    if n <= 0.0 or n * (2 * r - n) < 0.1 * u**2:
        assert -error <= 1.25 * float(travel_error_bound_mm(u, n)) + 1e-12


def test_a_carriage_inside_its_pulley_is_refused():
    with pytest.raises(CalibrationError, match="inside its pulley"):
        wire_length([8.0, 1.0], 1.0, 2.0)
