"""One insertion of the rod by a rigid gripper along a plan: what the studies of the array and its tests have in common.

Planned is for a model fitted to the array's own free shapes, as a calibration would (02 section 3); the gripper then goes
where the plan says, whatever the array does to it. So what is seen is mechanics, and neither control nor robot.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from hal.kernel import kernel
from rtctl.electrode.calibration import calibrate
from rtctl.electrode.planning import Plan, plan_insertion
from rtctl.electrode.robot_path import poses_in_base
from sim_backends.plant import scala as walls
from sim_backends.plant.options import Anatomy, Array, Phantom
from sim_backends.plant.rod import state
from sim_backends.plant.rod.step import advance, lift

START_MM = -2.0
"""The tip so far before the entry."""
LAST_MM = 13.8
"""Where insertions end; beyond, plans turn the gripper quickly (02 section 5)."""
SHARE = 0.95
"""Forces count over so much of an insertion, as in I."""
ACCESS_RAD = math.radians(12.0)
STEP_S = 1e-3
STYLET_MAX_MM = 15.0

TRACE = np.dtype(
    [
        ("wrench", "f8", (3,)),  # on the gripper in {B}, about its tip
        ("inserted_mm", "f8"),
        ("iterations", "i8"),
        ("lateral_n", "f8"),  # sum of what the lateral wall presses with
        ("modiolar_n", "f8"),
        ("lips_n", "f8"),
        ("set_per_mm", "f8"),
        ("folded", "u1"),
        ("buckled", "u1"),
    ],
    align=True,
)
"""One row a tick."""


@dataclass(frozen=True)
class Case:
    """What is inserted into what, and how.

    Attributes:
        array: the true one.
        planned: the one the plan was made for; None for the true one.
        lateral_mm, angle_rad: the specimen lies so far left of where the plan has it, and is turned.
        early_mm: the stylet was pulled so far before the insertion; negative: it starts as much later.
        with_stylet: False leaves the stylet where it is, all along (SIT, no AOS).
    """

    array: Array = field(default_factory=Array)
    planned: Array | None = None
    anatomy: Anatomy = field(default_factory=Anatomy)
    tissue: Phantom = field(default_factory=Phantom)
    lateral_mm: float = 0.0
    angle_rad: float = 0.0
    early_mm: float = 0.0
    with_stylet: bool = True
    speed_mm_per_s: float = 1.0
    step_s: float = STEP_S
    last_mm: float = LAST_MM


@dataclass(frozen=True)
class Motion:
    """Gripper and stylet tick by tick: depths in the plan (n,), poses in {B} (n, 3), withdrawals (n,)."""

    depth_mm: np.ndarray
    pose: np.ndarray
    stylet_mm: np.ndarray


@dataclass(frozen=True)
class Insertion:
    """What came of a case.

    Attributes:
        motion, trace: tick by tick (n,), up to where a step failed.
        force_n: on the gripper (n,) against the direction of insertion.
        aside_n: the same to the left of it.
        rod, scala: records (1,) at the end.
        us_per_tick: cost.
    """

    case: Case
    motion: Motion
    trace: np.ndarray
    force_n: np.ndarray
    aside_n: np.ndarray
    rod: np.ndarray
    scala: np.ndarray
    failed: bool
    us_per_tick: float

    @property
    def _counted(self) -> np.ndarray:
        depth = self.motion.depth_mm
        return (depth > 0.0) & (depth < SHARE * self.case.last_mm)

    @property
    def mean_n(self) -> float:
        """Mean insertion force from the entry over the part that counts."""
        return float(self.force_n[self._counted].mean())

    @property
    def peak_n(self) -> float:
        """Greatest insertion force of the same part."""
        return float(self.force_n[self._counted].max())

    @property
    def lateral_wall_n(self) -> float:
        """Mean of what the lateral wall presses with."""
        return float(self.trace["lateral_n"][self._counted].mean())

    @property
    def work_nmm(self) -> float:
        """What the gripper does along the insertion, over the part that counts."""
        return self.mean_n * SHARE * self.case.last_mm

    @property
    def folded(self) -> bool:
        """Whether the tip pointed backwards at some time."""
        return bool(self.trace["folded"].any())

    @property
    def stuck(self) -> bool:
        """Whether less than half of the array is inside at the end."""
        return bool(self.trace["inserted_mm"][-1] < 0.5 * self.case.last_mm)

    @property
    def buckled(self) -> bool:
        """Whether a permanent bend outside the entry was left."""
        return bool(self.trace["buckled"][-1])

    def at(self, depth_mm: np.ndarray, window_mm: float = 0.5) -> np.ndarray:
        """Insertion force around depths (k,), means over windows."""
        d = self.motion.depth_mm
        ends = np.searchsorted(d, np.stack((depth_mm - window_mm / 2, depth_mm + window_mm / 2)))
        total = np.append(0.0, np.cumsum(self.force_n))
        return (total[ends[1]] - total[ends[0]]) / (ends[1] - ends[0])


def new_records(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """ROD and SCALA of a case, shape (1,) each, the gripper empty."""
    rod, scala = np.zeros(1, state.ROD), np.zeros(1, walls.SCALA)
    state.pack(case.array, rod[0])
    axis_rad = case.anatomy.insertion_angle_rad
    left = np.array([-math.sin(axis_rad), math.cos(axis_rad)])
    entry = np.array(case.anatomy.entry_in_base_mm) + case.lateral_mm * left
    true = replace(
        case.anatomy,
        entry_in_base_mm=tuple(float(v) for v in entry),
        insertion_angle_rad=axis_rad + case.angle_rad,
    )
    walls.pack(true, case.tissue, scala[0])
    _lift(rod)
    return rod, scala


def motion_of(case: Case) -> Motion:
    """Along the axis up to the entry, then by the plan."""
    plan = plan_for(replace(case.planned or case.array, segments=Array().segments))
    anatomy = case.anatomy
    axis = np.array([math.cos(anatomy.insertion_angle_rad), math.sin(anatomy.insertion_angle_rad)])
    entry_pose = np.array([*anatomy.entry_in_base_mm, anatomy.insertion_angle_rad - ACCESS_RAD])
    depth = np.arange(START_MM, case.last_mm, case.speed_mm_per_s * case.step_s)
    inside = np.clip(depth, 0.0, None)
    pose = CubicSpline(plan.depth_mm, poses_in_base(plan.pose_in_cochlea, entry_pose))(inside)
    pose[:, :2] += np.minimum(depth, 0.0)[:, None] * axis
    stylet = np.zeros_like(depth)
    if case.with_stylet:
        stylet = PchipInterpolator(plan.depth_mm, plan.stylet_mm)(inside) + case.early_mm
        stylet = np.maximum.accumulate(np.clip(stylet, 0.0, STYLET_MAX_MM))
    return Motion(depth, np.ascontiguousarray(pose), stylet)


def insert(case: Case) -> Insertion:
    """Run a case."""
    rod, scala = new_records(case)
    motion = motion_of(case)
    trace = np.zeros(len(motion.depth_mm), TRACE)
    start = time.perf_counter()
    done = run_ticks(rod, scala, motion.pose, motion.stylet_mm, case.step_s, trace)
    elapsed_s = time.perf_counter() - start
    kept = Motion(motion.depth_mm[:done], motion.pose[:done], motion.stylet_mm[:done])
    trace = trace[:done]
    c, s = math.cos(case.anatomy.insertion_angle_rad), math.sin(case.anatomy.insertion_angle_rad)
    fx, fy = trace["wrench"][:, 0], trace["wrench"][:, 1]
    failed = done < len(motion.depth_mm)
    cost = elapsed_s / max(done, 1) * 1e6
    return Insertion(case, kept, trace, -(c * fx + s * fy), c * fy - s * fx, rod, scala, failed, cost)


def scattered(case: Case, random: np.random.Generator) -> Case:
    """The case as it comes out in the hands of people: with the scatter that the specimen's table tells."""
    t, draw = case.tissue, random.standard_normal(5)
    slippery = max(1.0 + t.friction_sd * float(draw[4]), 0.1)
    return replace(
        case,
        planned=case.planned or case.array,  # for the mean array
        lateral_mm=case.lateral_mm + t.lateral_sd_mm * float(draw[0]),
        angle_rad=case.angle_rad + t.angle_sd_rad * float(draw[1]),
        early_mm=case.early_mm - t.stylet_late_mm + t.stylet_sd_mm * float(draw[2]),
        array=replace(case.array, curvature_error=case.array.curvature_error + t.curvature_sd * float(draw[3])),
        tissue=replace(
            t,
            friction=slippery * t.friction,
            friction_static=slippery * t.friction_static,
            floor_load_n_per_mm=slippery * t.floor_load_n_per_mm,
        ),
    )


def scattered_runs(case: Case, count: int, seed: int) -> list[Insertion]:
    """`count` insertions of one case, each with its own scatter."""
    random = np.random.default_rng(seed)
    return [insert(scattered(case, random)) for _ in range(count)]


def rate(runs: Sequence[Insertion], what: str) -> float:
    """Share of the insertions that folded, buckled, or failed."""
    return float(np.mean([getattr(run, what) for run in runs]))


@cache
def plan_for(array: Array) -> Plan:
    """The plan for a mean array, from its calibrated model."""
    return plan_insertion(modal_matrix(array)[0])


def modal_matrix(array: Array) -> tuple[np.ndarray, float]:
    """A (4, 4) from the free shapes of the array at several withdrawals, and the residual's root mean square [rad]."""
    s = np.linspace(0.0, array.length_mm, 24)
    stylet = np.append(np.linspace(0.0, STYLET_MAX_MM - 1.0, 12), STYLET_MAX_MM)
    angle = free_angles(array, s, stylet)
    matrix = calibrate(s, stylet, angle)
    powers = np.arange(4)[:, None]
    residual = (s**powers).T @ matrix @ stylet**powers - angle
    return matrix, float(np.sqrt(np.mean(residual**2)))


def free_angles(array: Array, s_mm: np.ndarray, stylet_mm: np.ndarray) -> np.ndarray:
    """Bending angles (s, stylet) [rad] of the free array: the integral of its rest curvature (08 section 3)."""
    fine = np.linspace(0.0, array.length_mm, 1801)
    from_tip = array.length_mm - fine
    bending, rest = state.array_bending(array, from_tip), state.rest_curvature(array, from_tip)
    columns = []
    for withdrawn in stylet_mm:
        share = np.clip((from_tip - array.soft_tip_mm - withdrawn) / array.stylet_blend_mm + 0.5, 0.0, 1.0)
        wire = array.stylet_bending_nmm2 * share**2 * (3.0 - 2.0 * share)
        curvature = bending * rest / (bending + wire)
        angle = np.append(0.0, np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(fine)))
        columns.append(np.interp(s_mm, fine, angle))
    return np.stack(columns, axis=1)


@kernel
def _lift(rod):
    lift(rod[0])


@kernel
def run_ticks(rod, scala, pose, stylet_mm, step_s, trace):
    """Ticks that converged, from the first on; each leaves a row."""
    r = rod[0]
    for k in range(pose.shape[0]):
        if not advance(r, scala[0], pose[k], stylet_mm[k], step_s):
            return k
        row = trace[k]
        for c in range(3):
            row.wrench[c] = r.wrench[c]
        row.inserted_mm, row.iterations = r.depth_mm, r.iterations
        row.lateral_n, row.modiolar_n = r.lateral_n, r.modiolar_n
        row.lips_n = r.post_press_n[0] + r.post_press_n[1]
        row.set_per_mm, row.folded, row.buckled = r.set_per_mm, r.folded, r.buckled
    return pose.shape[0]
