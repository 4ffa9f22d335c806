"""Wire loop against the tensions of 01 section 1.1, backlash of 05 section 4, stiffness of 01 section 1.4."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.errors import OptionError
from hal.options import table_of
from rtctl.robots.planar_3rpr import Planar3rprOptions, forward, wire_jacobian
from sim_backends.plant import bench
from sim_backends.plant.backend import PlantBackend
from sim_backends.plant.transmission import LEG, carriage_of, drag_piston, pay_out, pull, stretch_under, wire_length

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


@pytest.mark.parametrize(
    ("straight_mm", "misalignment_mm", "length_mm"),
    [(8, 0.25, 8.003915519), (8, 0.5, 8.015691780), (8, 0.0, 8.0), (10, 0.0, 10.0), (10, 1e-12, 10.0)],
)
def test_wire_lengths_of_05_section_3(straight_mm, misalignment_mm, length_mm):
    assert wire_length(float(straight_mm), misalignment_mm, 2.0)[0] == pytest.approx(length_mm, abs=1e-9)


@pytest.mark.parametrize(("straight_mm", "stretch"), [(4, 1.007950), (8, 1.001961), (25, 1.000200)])
def test_stretch_of_05_section_3(straight_mm, stretch):
    assert wire_length(float(straight_mm), 0.5, 2.0)[0] / straight_mm == pytest.approx(stretch, abs=1e-6)


@settings(max_examples=80, deadline=None)
@given(u=st.floats(10, 60), n=st.floats(-2, 2), r=st.floats(0.5, 5))
def test_the_wire_is_the_shortest_way_round_the_pulley(u, n, r):
    """Arc plus tangent, with the point of contact found by hand in the plane: pulley at 0, carriage at (u, r - n)."""
    length, share = wire_length(u, n, r)
    carriage = np.array([u, r - n])
    distance = np.linalg.norm(carriage)
    contact = math.atan2(r - n, u) + math.acos(r / distance)
    leaves = r * np.array([math.cos(contact), math.sin(contact)])
    way = carriage - leaves
    assert length == pytest.approx(np.linalg.norm(way) + r * (math.pi / 2 - contact), abs=1e-9)
    assert share == pytest.approx(way[0] / np.linalg.norm(way), abs=1e-9)
    step = 1e-5
    slope = (wire_length(u + step, n, r)[0] - wire_length(u - step, n, r)[0]) / (2 * step)
    assert share == pytest.approx(slope, abs=1e-8)


def misaligned(n, straight_mm):
    one = leg()
    one["misalignment_mm"], one["pulley_radius_mm"], one["straight_mm"] = n, 2.0, straight_mm
    one["home_length_mm"] = wire_length(straight_mm, n, 2.0)[0]
    return one


@pytest.mark.parametrize(
    ("straight_mm", "travel_mm", "error_mm"),
    [(8.0, 1.0, -0.00176), (8.0, 20.0, -0.01123), (8.0, 45.0, -0.0133), (30.0, 45.0, -0.0025)],
)
def test_errors_of_05_section_3(straight_mm, travel_mm, error_mm):
    paid_out, _ = pay_out(misaligned(0.5, straight_mm), travel_mm)
    assert paid_out - travel_mm == pytest.approx(error_mm, abs=6e-5)
    assert -(0.5**2) / (2 * straight_mm) < paid_out - travel_mm <= 0.0


@settings(max_examples=40, deadline=None)
@given(n=st.floats(-2, 2), paid_out=st.floats(-1, 44))
def test_the_carriage_that_has_paid_out_a_wire(n, paid_out):
    one = misaligned(n, 25.0)
    assert pay_out(one, carriage_of(one, paid_out))[0] == pytest.approx(paid_out, abs=1e-12)


def test_the_pistons_of_the_bench_lag_by_the_misalignment(drive):
    """Without backlash and load the piston is where the wire puts it, not where the screw has gone."""
    n = (0.5, -0.5, 0.0)
    bench = drive({"wire": {"backlash_rad": [0.0] * 3, "misalignment_mm": list(n), "straight_mm": 12.0}})
    bench.run(800, 2.0)
    bench.run(400, 0.0)
    for i in range(3):
        carriage = float(bench.device["motor"][i]["angle_rad"] * bench.device["motor"][i]["lead_mm_per_rad"])
        expected = n[i] ** 2 / 2 * (1 / (12.0 + carriage) - 1 / 12.0)
        assert bench.device["leg"][i]["piston_mm"] - carriage == pytest.approx(expected, rel=0.05, abs=1e-9)
        assert carriage > 10.0


def test_a_carriage_has_to_be_clear_of_its_pulley():
    with pytest.raises(OptionError, match=r"wire\.straight_mm"):
        PlantBackend({"wire": {"straight_mm": 5.0}}, period_s=0.001, seed=0)
    table = {"wire": {"straight_mm": 10.0, "misalignment_mm": [2.0] * 3}, "geometry": {"pulley_radius_mm": [40.0] * 3}}
    with pytest.raises(OptionError, match="no room between carriage and pulley"):
        PlantBackend(table, period_s=0.001, seed=0)
