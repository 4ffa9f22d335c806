"""Spec 08 section 5, item 4: work goes somewhere, and the wrench is what the energy says (virtual work)."""

import math

import numpy as np
import pytest
from energy_book import keep

from bench.rod_insertion import Case, motion_of, new_records
from hal.kernel import kernel
from sim_backends.plant.options import Array
from sim_backends.plant.rod.band import eliminate, substitute
from sim_backends.plant.rod.contact import enter, touch
from sim_backends.plant.rod.elastic import assemble
from sim_backends.plant.rod.step import advance
from sim_backends.plant.rod.stylet import set_stylet

ELASTIC = Array(stylet_yield_per_mm=5.0, array_yield_per_mm=20.0)
"""Of a material that keeps no set, which would be one more account."""
DEPTHS_MM = (2.0, 6.0, 9.0, 12.0, 13.0)


@kernel
def _advance(rod, scala, pose, stylet_mm, step_s):
    return advance(rod[0], scala[0], pose, stylet_mm, step_s)


@kernel
def _run(rod, scala, pose, stylet_mm, step_s):
    failed = 0
    for k in range(pose.shape[0]):
        failed += not advance(rod[0], scala[0], pose[k], stylet_mm[k], step_s)
    return failed


@kernel
def _begin(rod, scala, stylet_mm, step_s):
    """What is fixed all through a step."""
    enter(rod[0], scala[0], step_s)
    set_stylet(rod[0], stylet_mm)


@kernel
def _evaluate(rod, scala, step_s, secant):
    assemble(rod[0], step_s)
    touch(rod[0], scala[0], step_s, secant)


@kernel
def _minimise(rod, scala, pose, step_s):
    """The step's minimum with the gripper at `pose`, by Newton's method to the last digit; its energy."""
    r = rod[0]
    n = r.segments
    c, s = math.cos(pose[2] + r.grip_angle_rad), math.sin(pose[2] + r.grip_angle_rad)
    for i in range(2):
        way = (i - 0.5) * r.edge_mm
        r.node_mm[i, 0], r.node_mm[i, 1] = pose[0] + way * c, pose[1] + way * s
    for _ in range(5000):
        _evaluate(rod, scala, step_s, True)
        eliminate(r.band, r.gradient, 2 * n - 2)
        substitute(r.band, r.gradient, 2 * n - 2)
        largest = 0.0
        for row in range(2 * n - 2):
            largest = max(largest, abs(r.gradient[row]))
        for i in range(2, n + 1):
            for k in range(2):
                r.node_mm[i, k] -= r.gradient[2 * (n - i) + k]
        if largest < 1e-11:
            break
    _evaluate(rod, scala, step_s, True)
    return r.energy_nmm


@pytest.fixture(scope="module")
def moments():
    """Every so deep into a default insertion: records, next pose and stylet, step; nothing is moved on yet."""
    case = Case(array=ELASTIC)
    rod, scala = new_records(case)
    motion, found, last = motion_of(case), [], 0
    for depth in DEPTHS_MM:
        k = int(np.searchsorted(motion.depth_mm, depth))
        assert _run(rod, scala, motion.pose[last:k], motion.stylet_mm[last:k], case.step_s) == 0
        found.append((rod.copy(), scala, motion.pose[k], motion.stylet_mm[k], case.step_s))
        last = k
    return found


def minimum(moment, near, shift=(0.0, 0.0, 0.0)):
    """Energy of the step's minimum with the gripper shifted, and the record there; `near` is the solver's answer."""
    rod, scala, pose, stylet_mm, step_s = moment
    rod = rod.copy()
    _begin(rod, scala, stylet_mm, step_s)
    rod["node_mm"] = near["node_mm"]
    return _minimise(rod, scala, pose + np.array(shift), step_s), rod[0]


@pytest.mark.parametrize("which", range(len(DEPTHS_MM)), ids=[f"{d:g}mm" for d in DEPTHS_MM])
def test_the_wrench_is_minus_the_slope_of_the_energy(moments, which):
    """Reciprocity: whatever the gripper does, its work is the change of the energy a step minimises."""
    rod, scala, pose, stylet_mm, step_s = moments[which]
    rod = rod.copy()
    assert _advance(rod, scala, pose, stylet_mm, step_s)
    slope = np.zeros(3)
    for k, by in enumerate((1e-5, 1e-5, 1e-6)):
        shift = np.zeros(3)
        shift[k] = by
        up, down = minimum(moments[which], rod, shift)[0], minimum(moments[which], rod, -shift)[0]
        slope[k] = (up - down) / (2 * by)
    assert rod["wrench"][0, :2] == pytest.approx(-slope[:2], rel=1e-2, abs=3e-4)
    assert rod["wrench"][0, 2] == pytest.approx(-slope[2], abs=2e-3)


@pytest.mark.parametrize("which", range(len(DEPTHS_MM)), ids=[f"{d:g}mm" for d in DEPTHS_MM])
def test_the_wrench_balances_what_touches_the_array(moments, which):
    """Equilibrium of the whole rod: force and moment about the gripper's tip; only the fluid's drag comes in between."""
    rod, scala, pose, stylet_mm, step_s = moments[which]
    rod = rod.copy()
    assert _advance(rod, scala, pose, stylet_mm, step_s)
    _, r = minimum(moments[which], rod)
    nodes = slice(0, r["segments"] + 1)
    x, force = r["node_mm"][nodes], r["force_n"][nodes]
    force = force - r["drag_n_s_per_mm"] / step_s * (x - r["before_mm"][nodes])
    arm = x - pose[:2]
    assert rod["wrench"][0, :2] == pytest.approx(force.sum(axis=0), rel=1e-2, abs=3e-4)
    assert rod["wrench"][0, 2] == pytest.approx((arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]).sum(), abs=2e-3)


@pytest.mark.parametrize("which", range(len(DEPTHS_MM)), ids=[f"{d:g}mm" for d in DEPTHS_MM])
def test_the_gradient_is_the_slope_of_the_energy(moments, which):
    """At a state that is no minimum, node by node."""
    rod, scala, _, stylet_mm, step_s = moments[which]
    rod = rod.copy()
    _begin(rod, scala, stylet_mm, step_s)
    r = rod[0]
    n = int(r["segments"])
    r["node_mm"][2 : n + 1] += np.random.default_rng(1).normal(0.0, 2e-3, (n - 1, 2))
    for _ in range(20):  # feet run after their nodes by Newton's method, one step a look
        _evaluate(rod, scala, step_s, True)
    gradient, by = r["gradient"].copy(), 1e-6
    worst = 0.0
    for i in range(2, n + 1):
        for k in range(2):
            ends = []
            for way in (by, -by):
                moved = rod.copy()
                moved["node_mm"][0, i, k] += way
                for _ in range(3):
                    _evaluate(moved, scala, step_s, True)
                ends.append(moved["energy_nmm"][0])
            worst = max(worst, abs((ends[0] - ends[1]) / (2 * by) - gradient[2 * (n - i) + k]))
    assert worst < 1e-5 * np.abs(gradient).max()


def test_work_goes_into_elastic_energy_friction_and_damping():
    """Over a whole insertion, within 1 %: of the rod by itself, with the forces of its contacts as they are."""
    book, _ = keep(Case(array=ELASTIC))
    end = book[-1]
    turnover = abs(end["gripper_nmm"]) + abs(end["stylet_nmm"])
    work = end["gripper_nmm"] + end["stylet_nmm"] + end["contacts_nmm"]
    assert end["gripper_nmm"] > 0.1
    assert end["stylet_nmm"] < -0.1  # the array curls and pushes it out
    assert work == pytest.approx(end["elastic_nmm"] + end["damping_nmm"], abs=0.01 * turnover)
    assert np.all(np.diff(book["damping_nmm"]) >= 0.0)
    assert np.all(np.diff(book["friction_nmm"]) >= 0.0)


def test_contacts_take_what_friction_costs_and_walls_store():
    """They do not quite: normals are held through a step and bodies taper, so a hundredth comes from nowhere."""
    book, _ = keep(Case(array=ELASTIC))
    end = book[-1]
    turnover = abs(end["gripper_nmm"]) + abs(end["stylet_nmm"])
    assert -end["contacts_nmm"] == pytest.approx(end["walls_nmm"] + end["friction_nmm"], abs=0.015 * turnover)
