"""A patient's cochlea is the template scaled by A, either ear; plans and paths follow it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from rtctl.electrode import cochlea
from rtctl.electrode.patient import TEMPLATE, Cochlea
from rtctl.electrode.planning import cost_of, depths_mm, plan_insertion
from rtctl.electrode.robot_path import poses_in_base, robot_path
from rtctl.electrode.synthetic_arrays import modal_matrix

SIZES = st.floats(3.2, 4.6)


def spiral_mm(a_mm, theta_deg):
    """r(theta) of (II.1) with its own constant C, as printed."""
    if theta_deg >= 100:
        return a_mm * np.exp(-0.001317 * theta_deg)
    c = a_mm * np.exp(-0.1317) / (1 - 0.12869 * np.log(95))
    return c * (1 - 0.12869 * np.log(theta_deg - 5))


@given(SIZES)
def test_lateral_wall_is_the_spiral_of_that_a(a_mm):
    radii = np.linalg.norm(Cochlea(a_mm).lateral_polyline(30.0, 730.3), axis=1)
    angles, _ = cochlea.wall_angles(30.0, 730.3)
    assert radii == pytest.approx([spiral_mm(a_mm, angle) for angle in angles])


@given(SIZES)
def test_scala_is_as_wide_as_it_is_large(a_mm):
    patient = Cochlea(a_mm)
    across = np.linalg.norm(patient.lateral_polyline(45.0) - patient.modiolar_polyline(45.0), axis=1)
    angles, _ = cochlea.wall_angles(45.0, 720.0)
    assert across == pytest.approx(cochlea.width_mm(angles) * a_mm / 3.84)


@given(SIZES)
def test_directions_do_not_depend_on_the_size(a_mm):
    path, template = Cochlea(a_mm).path(), cochlea.insertion_path()
    assert path.direction_rad == pytest.approx(template.direction_rad, abs=1e-12)
    assert path.tangency_deg == template.tangency_deg
    assert path.points(0.0) == pytest.approx(Cochlea(a_mm).insertion_point())
    steps = np.linalg.norm(np.diff(path.points(np.linspace(0, 12, 2401)), axis=0), axis=1)
    assert steps.max() == pytest.approx(0.005, rel=1e-9)  # still measured in millimetres along the wall


def test_a_small_cochlea_is_planned_as_far_as_its_wall_goes():
    assert depths_mm(TEMPLATE)[-1] == depths_mm(Cochlea(4.6))[-1] == 15.0
    for a_mm in (3.2, 3.5, 3.7):
        end = Cochlea(a_mm).path().length_mm[-1]
        plan = plan_insertion(modal_matrix(1), cochlea=Cochlea(a_mm))
        assert plan.depth_mm[-1] <= end < plan.depth_mm[-1] + 0.5
        assert len(plan.depth_mm) == len(plan.stylet_mm) == len(plan.cost) == len(plan.pose_in_cochlea)


@pytest.mark.parametrize("a_mm", [3.2, 4.5])
def test_no_start_of_an_independent_solver_finds_less(a_mm):
    """T and U of (II.20) in plain numpy, on the scaled walls."""
    modal, patient, depth = modal_matrix(3), Cochlea(a_mm), 9.0
    plan = plan_insertion(modal, cochlea=patient)
    k = a_mm / 3.84
    wall = k * cochlea.modiolar_polyline(0.1, 720.0)
    nodes = np.arange(round((18 - depth) / 0.5), 37)
    target = k * cochlea.insertion_path().points((depth - 18 + nodes * 0.5) / k)

    def residuals(x):
        s = np.linspace(0, 18, 3601)
        angle = np.vander(s, 4, increasing=True) @ modal @ x[3] ** np.arange(4.0) + x[2]
        tangent = np.stack((np.cos(angle), np.sin(angle)), axis=1)
        shape = x[:2] + np.vstack((np.zeros(2), np.cumsum((tangent[1:] + tangent[:-1]) / 2 * 0.005, axis=0)))
        points = shape[nodes * 100]
        distance = np.linalg.norm(points[:, None] - wall[None], axis=2)
        inside = np.linalg.norm(wall[distance.argmin(axis=1)], axis=1) > np.linalg.norm(points, axis=1)
        return np.concatenate(((target - points).ravel(), np.where(inside, distance.min(axis=1), 0.0)))

    i = round(depth / 0.5)
    best = np.append(plan.pose_in_cochlea[i], plan.stylet_mm[i])
    assert 0.5 * residuals(best) @ residuals(best) == pytest.approx(plan.cost[i], rel=5e-3, abs=1e-4)
    rng = np.random.default_rng(1)
    window = np.radians(146.342) + np.radians(17.0) * np.array([-1.0, 1.0])
    low, high = np.array([-40, -40, window[0], 0]), np.array([40, 40, window[1], 15.0])
    for _ in range(3):
        start = np.clip(best + rng.normal(0, (1.0, 1.0, 0.1, 2.0)), low + 1e-6, high - 1e-6)
        found = least_squares(residuals, start, bounds=(low, high), max_nfev=40)
        assert found.cost > plan.cost[i] * 0.99


def test_costs_computed_anew_are_those_of_the_planning():
    plan = plan_insertion(modal_matrix(5), cochlea=Cochlea(4.1))
    assert cost_of(plan) == pytest.approx(plan.cost, rel=1e-12, abs=1e-15)


@given(SIZES)
def test_the_entry_is_where_it_was_registered_whatever_the_size(a_mm):
    patient, entry = Cochlea(a_mm), np.array([171.0, 4.0, 0.2])
    at_entry = np.append(patient.insertion_point(), 0.0)[None]
    assert poses_in_base(at_entry, entry, patient)[0, :2] == pytest.approx(entry[:2])


def test_in_the_base_a_left_ear_is_planned_as_a_right_one():
    entry = np.array([171.0, 4.0, 0.1])
    paths = [
        robot_path(plan_insertion(modal_matrix(1), cochlea=Cochlea(3.9, side)), entry, 1) for side in ("right", "left")
    ]
    assert paths[0].tobytes() == paths[1].tobytes()


def test_a_narrower_window_is_kept_and_costs():
    wide, narrow = (plan_insertion(modal_matrix(1), window_rad=w) for w in (np.radians(17), np.radians(10)))
    turned = np.abs(narrow.pose_in_cochlea[:, 2] - np.radians(146.342))
    assert turned.max() == pytest.approx(np.radians(10), abs=1e-9)
    assert narrow.cost.sum() > wide.cost.sum()
