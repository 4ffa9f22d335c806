"""Insertion planning: gripper pose and stylet withdrawal for every depth (spec 02 section 5; (II.20)-(II.23)).

At each depth the inserted part of the array shall lie on the insertion path and outside the modiolus. The depths are
solved one after the other, each starting from the last, with a stylet that never goes back in.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from hal.errors import RtctlError
from rtctl.electrode.array_shape import LENGTH_MM, ORDER, STYLET_MAX_MM, shape_point, tip
from rtctl.electrode.insertion_cost import STEP_MM, insertion_cost
from rtctl.electrode.patient import RECESS_ANGLE_RAD, TEMPLATE, Cochlea

DEPTHS_MM = np.arange(0.0, 15.0 + STEP_MM / 2, STEP_MM)
WALL_OF_PATH_DEG, WALL_OF_DISTANCE_DEG = 0.25, 1.0
"""Steps of the wall's polyline, for the path and for the distance U to it."""
CHORD_MM = 3.0
"""The chord of this last part of the array points along the insertion direction when the insertion starts."""

APPROACH_RAD = math.radians(146.342)
"""phi_C, the gripper's mean orientation in {C}: 12 deg short of the insertion direction."""

PROXIMAL = np.array([1e-3, 1e-3, 1e-1, 1e-3])
"""Weights of the change of (b_x, b_y, phi, q_s) since the last depth; they only decide between equal costs."""

ITERATIONS = 200
SCAN_ANGLES, SEARCH_ANGLES = 18, 20
Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class Plan:
    """Result of the planning over n depths: 31, or fewer where the cochlea is too small for 15 mm.

    modal_matrix: A (4, 4) of the array it is for.
    cochlea: the cochlea it is for.
    depth_mm: depths (n,), every 0.5 mm from 0 on.
    pose_in_cochlea: gripper poses (n, 3): b_x, b_y [mm], phi [rad] of {E} in {C}.
    stylet_mm: stylet withdrawals (n,), non-decreasing.
    cost: (T^T T + U^T U) / 2 (n,) [mm^2], without the tie-break.
    """

    modal_matrix: np.ndarray
    cochlea: Cochlea
    depth_mm: np.ndarray
    pose_in_cochlea: np.ndarray
    stylet_mm: np.ndarray
    cost: np.ndarray

    @property
    def rms_mm(self) -> np.ndarray:
        """Root mean square residual (n,) over the inserted nodes."""
        return np.sqrt(2 * self.cost / np.arange(1, len(self.cost) + 1))


def plan_insertion(
    modal_matrix: np.ndarray,
    progress: Progress | None = None,
    *,
    cochlea: Cochlea = TEMPLATE,
    window_rad: float = RECESS_ANGLE_RAD,
) -> Plan:
    """The plan for a gripper that turns while it inserts (4 DoF).

    Args:
        modal_matrix: A (4, 4) of the array.
        progress: called as progress(i, n) after each of the n steps; what it raises ends the planning.
        cochlea: of the patient.
        window_rad: how far the gripper may turn to either side of its mean orientation phi_C.

    Raises:
        RtctlError: the modal matrix is not (4, 4) or not finite.
    """
    problem, direction = _problem(modal_matrix, cochlea)
    window = APPROACH_RAD - window_rad, APPROACH_RAD + window_rad
    phi = min(max(_free_start_angle(problem, direction), window[0]), window[1])
    return _plan(problem, cochlea, *_follow(problem, _tip_on_entry(problem, phi), window, progress or _silent))


def plan_insertion_without_turning(modal_matrix: np.ndarray, progress: Progress | None = None) -> Plan:
    """The plan for a gripper of constant orientation (3 DoF): the best one in the window, by the summed cost.

    Only a comparison, in the template's cochlea. Its place b at depth 0 is that of the turning gripper, so the tip
    misses p_c there, and the miss counts: this reproduces the reference figures of spec 02 section 5 (28 % less summed
    RMS by turning; 20 % if the tip is put on p_c first).

    Raises:
        RtctlError: as :func:`plan_insertion`.
    """
    problem, direction = _problem(modal_matrix, TEMPLATE)
    start = _tip_on_entry(problem, _free_start_angle(problem, direction))
    report, total = progress or _silent, SCAN_ANGLES + SEARCH_ANGLES
    done = 0

    def held_at(phi: float) -> tuple[np.ndarray, np.ndarray]:
        return _follow(problem, np.array([start[0], start[1], phi, 0.0]), (phi, phi), _silent)

    def summed_cost(phi: float) -> float:
        nonlocal done
        cost = float(held_at(phi)[1].sum())
        done += 1
        report(done, total)
        return cost

    angles = np.linspace(APPROACH_RAD - RECESS_ANGLE_RAD, APPROACH_RAD + RECESS_ANGLE_RAD, SCAN_ANGLES)
    best = int(np.argmin([summed_cost(phi) for phi in angles]))
    bounds = (angles[max(best - 1, 0)], angles[min(best + 1, SCAN_ANGLES - 1)])
    found = minimize_scalar(summed_cost, bounds=bounds, method="bounded", options={"maxiter": SEARCH_ANGLES})
    report(total, total)
    return _plan(problem, TEMPLATE, *held_at(float(found.x)))


def cost_of(plan: Plan) -> np.ndarray:
    """The cost (n,) [mm^2] of every depth of `plan`, computed anew from its array, cochlea and poses.

    Raises:
        RtctlError: as :func:`plan_insertion`.
    """
    problem, _ = _problem(plan.modal_matrix, plan.cochlea)
    states = np.column_stack((plan.pose_in_cochlea, plan.stylet_mm))
    return np.array([insertion_cost(*problem, i, x, np.zeros(4), np.zeros((4, 4))) for i, x in enumerate(states)])


def depths_mm(cochlea: Cochlea) -> np.ndarray:
    """Depths (n,) that can be planned: every 0.5 mm to 15 mm, or to the end of the path of a small cochlea."""
    return DEPTHS_MM[cochlea.path(WALL_OF_PATH_DEG).length_mm[-1] >= DEPTHS_MM]


def _silent(_done: int, _total: int) -> None:
    """Nobody wants to know."""


class _Problem(NamedTuple):
    """What stays the same over the depths, as :func:`insertion_cost` takes it."""

    modal_matrix: np.ndarray
    path: np.ndarray
    """Points (n, 2) of the insertion path, every 0.5 mm, in {C}."""
    wall: np.ndarray
    """Vertices (n, 2) of the modiolar wall in {C}."""


def _problem(modal_matrix: np.ndarray, cochlea: Cochlea) -> tuple[_Problem, float]:
    """The problem and the direction of insertion [rad]."""
    matrix = np.ascontiguousarray(modal_matrix, dtype=float)
    if matrix.shape != (ORDER, ORDER) or not np.isfinite(matrix).all():
        raise RtctlError("no insertion plan for this modal matrix", value=matrix.tolist(), bound="4 x 4 finite numbers")
    path = cochlea.path(WALL_OF_PATH_DEG)
    wall = cochlea.modiolar_polyline(WALL_OF_DISTANCE_DEG)
    return _Problem(matrix, path.points(depths_mm(cochlea)), wall), path.direction_rad


def _free_start_angle(problem: _Problem, direction_rad: float) -> float:
    """phi that points the chord of the last 3 mm, stylet in, along the direction of insertion."""
    tip_x, tip_y = tip(problem.modal_matrix, 0.0)
    x, y = shape_point(problem.modal_matrix, 0.0, LENGTH_MM - CHORD_MM)
    return direction_rad - math.atan2(tip_y - y, tip_x - x)


def _tip_on_entry(problem: _Problem, phi: float) -> np.ndarray:
    """(b_x, b_y, phi, q_s) at depth 0: the tip on p_c, stylet in."""
    x, y = tip(problem.modal_matrix, 0.0)
    c, s = math.cos(phi), math.sin(phi)
    return np.array([problem.path[0, 0] - c * x + s * y, problem.path[0, 1] - s * x - c * y, phi, 0.0])


def _follow(
    problem: _Problem, start: np.ndarray, window: tuple[float, float], progress: Progress
) -> tuple[np.ndarray, np.ndarray]:
    """Solve depth after depth from `start`: states (n, 4) and costs (n,)."""
    lower = np.array([-np.inf, -np.inf, window[0], 0.0])
    upper = np.array([np.inf, np.inf, window[1], STYLET_MAX_MM])
    x, cost = start, _evaluate(problem, 0, start, start)[1]
    states, costs, count = [x], [cost], len(problem.path)
    progress(1, count)
    for i in range(1, count):
        x, cost = _solve(problem, i, x, lower, upper)
        lower[3] = x[3]
        states.append(x)
        costs.append(cost)
        progress(i + 1, count)
    return np.array(states), np.array(costs)


def _plan(problem: _Problem, cochlea: Cochlea, states: np.ndarray, costs: np.ndarray) -> Plan:
    depths = DEPTHS_MM[: len(costs)].copy()
    return Plan(problem.modal_matrix, cochlea, depths, states[:, :3], states[:, 3], costs)


def _solve(
    problem: _Problem, inserted: int, last: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, float]:
    """Bounded Levenberg-Marquardt from the `last` depth: variables pushed against a bound rest, steps are clipped."""
    x = last.copy()
    objective, cost, gradient, hessian = _evaluate(problem, inserted, x, last)
    damping = 1e-3
    for _ in range(ITERATIONS):
        free = (lower < upper) & ~((x <= lower) & (gradient > 0)) & ~((x >= upper) & (gradient < 0))
        reduced = hessian[np.ix_(free, free)]
        step = np.zeros(4)
        step[free] = np.linalg.solve(reduced + damping * np.diag(np.diag(reduced)), -gradient[free])
        trial = np.clip(x + step, lower, upper)
        if np.abs(trial - x).max() < 1e-10:
            break
        outcome = _evaluate(problem, inserted, trial, last)
        if outcome[0] < objective:
            x, damping = trial, max(damping / 10, 1e-12)
            objective, cost, gradient, hessian = outcome
        else:
            damping *= 10
    return x, cost


def _evaluate(
    problem: _Problem, inserted: int, x: np.ndarray, last: np.ndarray
) -> tuple[float, float, np.ndarray, np.ndarray]:
    """Objective with tie-break, cost without, gradient (4,) and Gauss-Newton Hessian (4, 4) of the objective."""
    gradient, hessian = np.zeros(4), np.zeros((4, 4))
    cost = insertion_cost(*problem, inserted, x, gradient, hessian)
    change = PROXIMAL * (x - last)
    gradient += PROXIMAL * change
    hessian[np.diag_indices(4)] += PROXIMAL**2
    return cost + 0.5 * float(change @ change), cost, gradient, hessian
