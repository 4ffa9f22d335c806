"""Insertion planning against the study numbers of spec 02 section 5 and an independent solver."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from hal.errors import RtctlError
from rtctl.electrode import cochlea
from rtctl.electrode.insertion_cost import insertion_cost
from rtctl.electrode.planning import (
    APPROACH_RAD,
    plan_insertion,
    plan_insertion_without_turning,
)
from rtctl.electrode.synthetic_arrays import modal_matrix

NUMBERS = range(1, 8)
LOWEST_RAD, HIGHEST_RAD = APPROACH_RAD - np.radians(17), APPROACH_RAD + np.radians(17)


@pytest.fixture(scope="module")
def turning():
    return {k: plan_insertion(modal_matrix(k)) for k in NUMBERS}


@pytest.fixture(scope="module")
def held():
    return {k: plan_insertion_without_turning(modal_matrix(k)) for k in NUMBERS}


def residuals(modal, depth, x):
    """T and U of (II.20) in plain numpy: trapezoids for the shape, a search over the vertices of a fine wall."""
    s = np.linspace(0, 18, 3601)
    angle = np.vander(s, 4, increasing=True) @ modal @ x[3] ** np.arange(4.0) + x[2]
    tangent = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    shape = x[:2] + np.vstack((np.zeros(2), np.cumsum((tangent[1:] + tangent[:-1]) / 2 * 0.005, axis=0)))
    nodes = np.arange(round((18 - depth) / 0.5), 37)
    points = shape[nodes * 100]
    t = cochlea.insertion_path().points(depth - 18 + nodes * 0.5) - points
    wall = cochlea.modiolar_polyline(0.1, 720.0)
    distance = np.linalg.norm(points[:, None] - wall[None], axis=2)
    closest = distance.argmin(axis=1)
    inside = np.linalg.norm(wall[closest], axis=1) > np.linalg.norm(points, axis=1)
    return np.concatenate((t.ravel(), np.where(inside, distance.min(axis=1), 0.0)))


def state(plan, depth):
    i = round(depth / 0.5)
    return np.append(plan.pose_in_cochlea[i], plan.stylet_mm[i])


def test_first_pose_of_array_1(turning):
    assert turning[1].cost[0] == pytest.approx(0.0, abs=1e-20)
    assert state(turning[1], 0) == pytest.approx((20.744665, -6.957292, 2.606371, 0.0), abs=2e-6)


@pytest.mark.parametrize(
    ("depth", "cost", "x"),
    [
        (6.0, 0.039465, (13.361124, -7.485164, 2.348524, 1.972505)),
        (12.0, 1.718566, (8.524968, -3.530348, 2.257450, 13.081950)),
    ],
)
def test_costs_and_poses_of_array_1(turning, depth, cost, x):
    assert turning[1].cost[round(depth / 0.5)] == pytest.approx(cost, rel=1e-3)
    assert state(turning[1], depth) == pytest.approx(x, abs=1e-3)


def test_small_depths_are_followed_exactly(turning):
    assert turning[1].cost[6] < 1e-5


@pytest.mark.parametrize("depth", [4.5, 9.0, 12.0, 15.0])
def test_reported_cost_is_that_of_the_pose(turning, depth):
    r = residuals(modal_matrix(1), depth, state(turning[1], depth))
    assert r @ r / 2 == pytest.approx(turning[1].cost[round(depth / 0.5)], rel=5e-3)


@pytest.mark.parametrize("depth", [6.0, 9.0, 12.0, 15.0])
def test_no_start_of_an_independent_solver_finds_less(turning, depth):
    modal, rng = modal_matrix(1), np.random.default_rng(int(depth))
    best = state(turning[1], depth)
    low, high = np.array([-40, -40, LOWEST_RAD, 0]), np.array([40, 40, HIGHEST_RAD, 15.0])
    costs = []
    for _ in range(4):
        start = best + rng.normal(0, (2.0, 2.0, 0.15, 4.0))
        margin = 1e-6 * (high - low)
        start = np.clip(start, low + margin, high - margin)
        costs.append(least_squares(lambda x: residuals(modal, depth, x), start, bounds=(low, high), max_nfev=40).cost)
    assert min(costs) > turning[1].cost[round(depth / 0.5)] * 0.99


@pytest.mark.parametrize(
    ("number", "with_turning", "without"),
    [(1, 142.92, 173.26), (3, 93.61, 119.13), (5, 117.00, 145.14), (7, 79.30, 101.40)],
)
def test_summed_costs(turning, held, number, with_turning, without):
    assert turning[number].cost.sum() == pytest.approx(with_turning, rel=0.02)
    assert held[number].cost.sum() == pytest.approx(without, rel=0.02)


def test_turning_pays(turning, held):
    cost = np.array([1 - turning[k].cost.sum() / held[k].cost.sum() for k in NUMBERS])
    rms = np.array([1 - turning[k].rms_mm.sum() / held[k].rms_mm.sum() for k in NUMBERS])
    before_9_mm = np.array([1 - turning[k].rms_mm[:19].sum() / held[k].rms_mm[:19].sum() for k in NUMBERS])
    assert cost.min() > 0
    assert rms.min() > 0
    assert cost.mean() == pytest.approx(0.176, abs=0.02)
    assert rms.mean() == pytest.approx(0.278, abs=0.02)
    assert before_9_mm.mean() > rms.mean()


@pytest.mark.parametrize("number", NUMBERS)
def test_turning_pays_even_without_counting_the_start(turning, held, number):
    assert turning[number].cost[1:].sum() < held[number].cost[1:].sum()
    assert turning[number].rms_mm[1:].sum() < held[number].rms_mm[1:].sum()


@pytest.mark.parametrize("number", NUMBERS)
def test_bounds_hold(turning, held, number):
    for plan in (turning[number], held[number]):
        assert np.diff(plan.stylet_mm).min() >= 0
        assert plan.stylet_mm[0] == 0
        assert plan.stylet_mm[-1] <= 15
        assert np.abs(plan.pose_in_cochlea[:, 2] - APPROACH_RAD).max() <= np.radians(17) + 1e-12
    assert np.ptp(held[number].pose_in_cochlea[:, 2]) == 0


def test_start_outside_the_window_still_puts_the_tip_on_the_entry():
    bent = modal_matrix(1)
    bent[0, 0] += 0.6  # the whole array leaves the grip at 34 deg
    plan = plan_insertion(bent)
    assert plan.pose_in_cochlea[0, 2] == pytest.approx(LOWEST_RAD)
    assert plan.cost[0] == pytest.approx(0.0, abs=1e-20)


def test_progress_is_reported_to_its_end():
    for plan in (plan_insertion, plan_insertion_without_turning):
        seen = []
        plan(modal_matrix(5), lambda done, total, seen=seen: seen.append((done, total)))
        done = [d for d, _ in seen]
        assert done == sorted(done)
        assert seen[-1][0] == seen[-1][1]


def test_progress_can_end_the_planning():
    def stop(done, _total):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plan_insertion(modal_matrix(1), stop)


@pytest.mark.parametrize("modal", [np.full((4, 4), np.nan), np.zeros((3, 4))])
def test_useless_matrix_is_refused(modal):
    with pytest.raises(RtctlError, match="modal matrix"):
        plan_insertion(modal)


@pytest.mark.parametrize("inserted", [6, 18, 27])
def test_gradient_of_the_cost_agrees_with_finite_differences(turning, inserted):
    path = cochlea.insertion_path().points(np.arange(31) * 0.5)
    wall = cochlea.modiolar_polyline(1.0, 720.0)

    def cost(x):
        gradient, hessian = np.zeros(4), np.zeros((4, 4))
        return insertion_cost(modal_matrix(1), path, wall, inserted, x, gradient, hessian), gradient

    x = state(turning[1], inserted / 2) + np.array([0.05, -0.03, 0.02, -0.4])
    steps = 1e-6 * np.eye(4)
    difference = [(cost(x + h)[0] - cost(x - h)[0]) / 2e-6 for h in steps]
    assert cost(x)[1] == pytest.approx(difference, rel=1e-5, abs=1e-6)
