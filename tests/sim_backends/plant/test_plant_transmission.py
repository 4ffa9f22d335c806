"""Wire loop against the tensions of 01 section 1.1, backlash of 05 section 4, stiffness of 01 section 1.4."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.options import table_of
from rtctl.robots.planar_3rpr import Planar3rprOptions, forward, wire_jacobian
from sim_backends.plant import bench
from sim_backends.plant.transmission import LEG, drag_piston, pull, stretch_under

K1, K2, T0 = 3200 / 150, 3200 / 220, 15.0
ETA = 0.097


def leg(backlash_rad=0.0):
    one = np.zeros(1, LEG)[0]
    one["near_n_per_mm"], one["far_n_per_mm"], one["pretension_n"], one["settling_s"] = K1, K2, T0, 0.004
    one["friction_n"] = backlash_rad * ETA / 2 * (K1 + K2)
    return one


def settle(one, carriage_mm, load_n=0.0, gain=0.0):
    for _ in range(400):
        force = drag_piston(one, carriage_mm, load_n, gain, 5e-4)
    return force


def test_both_segments_share_a_small_stretch():
    one = leg()
    assert pull(one, 0.1) == pytest.approx(0.1 * (K1 + K2))
    assert (one["near_n"], one["far_n"]) == pytest.approx((T0 + 0.1 * K1, T0 - 0.1 * K2))


def test_a_segment_goes_slack_where_the_pretension_is_used_up():
    one = leg()
    for stretch, slack in ((1.0001 * T0 / K2, "far_n"), (-1.0001 * T0 / K1, "near_n")):
        pull(one, stretch)
        assert one[slack] == 0.0
        pull(one, stretch * 0.999)
        assert one[slack] > 0.0
    # the far segment goes slack at tau = t (1 + k1/k2) (01 section 1.6, erratum 5)
    assert pull(one, T0 / K2) == pytest.approx(T0 * (1 + K1 / K2))


@settings(max_examples=60, deadline=None)
@given(force=st.floats(-200, 200))
def test_stretch_under_a_force_is_the_inverse_of_the_pull(force):
    one = leg()
    assert pull(one, stretch_under(one, force)) == pytest.approx(force, abs=1e-9)


@pytest.mark.parametrize("backlash_rad", [0.0, 1.5, 2.4])
def test_the_loop_between_motor_and_piston_is_as_wide_as_the_backlash(backlash_rad):
    one = leg(backlash_rad)
    path = np.concatenate((np.linspace(0, 1, 400), np.linspace(1, 0, 400), np.linspace(0, 1, 400)))
    piston = []
    for carriage in path:
        settle(one, carriage)
        piston.append(float(one["piston_mm"]))
    at = 200  # the middle of a stroke, well after the last reversal
    width_mm = piston[400 + 399 - at] - piston[800 + at]
    assert width_mm / ETA == pytest.approx(backlash_rad, abs=1e-6)


def test_a_reversal_smaller_than_the_backlash_does_not_move_the_piston():
    one = leg(2.0)
    settle(one, 1.0)
    before = float(one["piston_mm"])
    settle(one, 1.0 - 0.98 * 2.0 * ETA)
    assert one["piston_mm"] == before
    settle(one, 1.0 - 1.10 * 2.0 * ETA)
    assert one["piston_mm"] == pytest.approx(before - 0.10 * 2.0 * ETA, abs=1e-6)


def test_a_load_within_the_friction_moves_nothing_and_beyond_it_stretches_the_wire():
    one = leg(2.0)
    friction = float(one["friction_n"])
    settle(one, 0.0, load_n=0.95 * friction)
    assert one["piston_mm"] == 0.0
    settle(one, 0.0, load_n=friction + 1.0)
    assert one["piston_mm"] == pytest.approx(1.0 / (K1 + K2), rel=1e-6)


def test_a_stiff_surrounding_is_met_without_oscillation():
    """Two springs coupled by the force of the tick before, one forty times stiffer than the wire."""
    one, stiffness, load = leg(), 40 * (K1 + K2), 0.0
    places = []
    for _ in range(3000):
        drag_piston(one, 0.1, load, 40.0, 5e-4)
        drag_piston(one, 0.1, load, 40.0, 5e-4)
        load = -stiffness * float(one["piston_mm"])
        places.append(float(one["piston_mm"]))
    assert places[-1] == pytest.approx(0.1 / 41, rel=1e-6)
    assert max(places) < 1.02 * 0.1 / 41


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_gripper_gives_way_by_the_compliance_of_the_wires(drive, axis):
    """K_p of 01 section 1.4 at (162.5, 0, 5.5 deg): EA = 3200 N, h = 150/220 mm, r = 2 mm."""
    pose = (162.5, 0.0, math.radians(5.5))
    table = {
        "geometry": table_of(Planar3rprOptions()),
        "wire": {"backlash_rad": [0.0] * 3},
        "start_pose_mm_rad": list(pose),
    }
    d = drive(table).device
    wrench = np.zeros(3)
    wrench[axis] = (0.05, 0.001, 0.1)[axis]
    d["wrench"] = wrench
    bench._load_wires(d)
    for _ in range(400):
        assert not bench._drive(d, False)
    forward(d["robot"], d["motor_angle"], d["pose"])
    moved = d["pose"] - pose
    j = np.zeros((3, 3))
    wire_jacobian(d["robot"], np.array(pose), j)
    expected = np.linalg.solve(j.T @ j * (K1 + K2), wrench)
    assert moved == pytest.approx(expected, rel=0.01, abs=1e-7)
    if axis == 1:
        assert moved[1] / wrench[1] == pytest.approx(6.616988, rel=5e-3)
