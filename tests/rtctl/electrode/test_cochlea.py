"""The cochlea template against the identities of spec 02 section 1."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rtctl.electrode import cochlea


def test_constant_of_the_basal_branch_follows_from_continuity():
    assert pytest.approx(8.13157369446593, abs=1e-14) == cochlea.SPIRAL_C_MM
    assert cochlea.lateral_wall(100.0, True) == pytest.approx(cochlea.lateral_wall(100.0, False), abs=1e-14)


@pytest.mark.parametrize(
    ("theta_deg", "radius", "width", "lateral", "modiolar"),
    [
        (10.3, 6.386398, 1.6600, (6.386398, 0), (5.570332, -1.445558)),
        (23, 5.106938, 1.6504, (4.981994, 1.122741), (3.831657, -0.060759)),
        (100, 3.366159, 1.5789, (0.017625, 3.366113), (0.128183, 1.791100)),
        (360, 2.390141, 1.2100, (2.351624, -0.427363), (1.148219, -0.301204)),
        (910, 1.158357, 1.0803, (-1.158341, 0.006065), (-0.080685, 0.081711)),
    ],
)
def test_table_of_walls(theta_deg, radius, width, lateral, modiolar):
    assert np.linalg.norm(cochlea.lateral_wall(theta_deg)) == pytest.approx(radius, abs=1e-6)
    assert cochlea.width_mm(theta_deg) == pytest.approx(width, abs=5.1e-5)
    assert cochlea.lateral_wall(theta_deg) == pytest.approx(lateral, abs=1e-6)
    assert cochlea.modiolar_wall(theta_deg) == pytest.approx(modiolar, abs=1e-6)


def test_height_is_linear_between_the_measured_angles():
    assert cochlea.height_mm([0, 95, 135, 675, 1000]) == pytest.approx([1.25, 1.22 - 0.19 * 5 / 90, 1.125, 0.65, 0.65])


def test_tangent_jumps_at_the_kink():
    (nx, ny), (mx, my) = cochlea.inward_normal(100.0, True), cochlea.inward_normal(100.0, False)
    assert np.degrees(np.arctan2(nx * my - ny * mx, nx * mx + ny * my)) == pytest.approx(-6.30396, abs=1e-5)
    gap = cochlea.modiolar_wall(100.0, True) - cochlea.modiolar_wall(100.0, False)
    assert np.linalg.norm(gap) == pytest.approx(0.17, abs=0.005)


@given(st.floats(10.3, 910.0))
def test_normal_is_perpendicular_to_the_wall_and_points_inwards(theta_deg):
    assume(abs(theta_deg - cochlea.KINK_DEG) > 1e-3)
    tangent = cochlea.lateral_wall(theta_deg + 1e-4) - cochlea.lateral_wall(theta_deg - 1e-4)
    normal = cochlea.inward_normal(theta_deg)
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert normal @ tangent / np.linalg.norm(tangent) == pytest.approx(0.0, abs=1e-6)
    assert normal @ cochlea.lateral_wall(theta_deg) < 0


def test_polylines_keep_both_sides_of_the_kink_and_both_ends():
    angles, basal = cochlea.wall_angles(7.0, 400.0)
    assert (angles[0], angles[-1]) == (10.3, 400.0)
    assert list(basal[angles == 100.0]) == [True, False]
    assert (np.diff(angles) >= 0).all()
    assert (np.diff(basal.astype(int)) <= 0).all()


def test_wall_lengths():
    lateral = cochlea.arc_length_mm(cochlea.lateral_polyline(0.05, 370.3))[-1]
    modiolar = cochlea.arc_length_mm(cochlea.modiolar_polyline(0.05))[-1]
    assert lateral == pytest.approx(20.8924, abs=1e-4)
    assert modiolar == pytest.approx(18.0112, abs=1e-4)


def test_insertion_point():
    assert cochlea.insertion_point() == pytest.approx((4.406825, 0.530991), abs=1e-6)


def test_tangency_of_the_insertion_path():
    path = cochlea.insertion_path(step_deg=1e-4, last_deg=110.0)
    assert path.tangency_deg == pytest.approx(65.02554, abs=1e-4)
    assert np.degrees(path.direction_rad) == pytest.approx(158.342341, abs=1e-6)
    assert path.length_mm[1] == pytest.approx(2.967612, abs=5e-6)


@pytest.mark.parametrize("step_deg", [0.25, 0.1])
def test_points_of_the_insertion_path(step_deg):
    expected = [(1.61855, 1.63802), (-0.61103, -1.27716), (-0.11194, -0.36271)]
    assert cochlea.insertion_path(step_deg).points([3, 9, 15]) == pytest.approx(np.array(expected), abs=1e-3)


def test_insertion_path_is_measured_by_arc_length_and_held_at_its_ends():
    path = cochlea.insertion_path()
    steps = np.linalg.norm(np.diff(path.points(np.linspace(0, 15, 3001)), axis=0), axis=1)
    assert steps.max() == pytest.approx(0.005, rel=1e-9)
    assert path.points(-1.0) == pytest.approx(cochlea.insertion_point())
    assert path.points(1e3) == pytest.approx(path.vertices[-1])


def test_straight_part_stays_clear_of_the_lateral_wall():
    line = cochlea.insertion_path().points(np.linspace(0, 2.96, 60))
    wall = cochlea.lateral_polyline(0.1, 120.0)
    assert np.linalg.norm(line[:, None] - wall[None], axis=2).min() > 0.8
