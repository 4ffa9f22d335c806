"""Simulated insertions as the force curves over depth that the sources tell of."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rtctl.electrode.planning import Plan
from rtctl.guidance.force_model import FULL_DEPTH_MM
from rtctl.settings import Settings
from rtctl.simulation import simulate

LAMBDA = np.linspace(0.0, 1.0, 139)
COUNTED = LAMBDA <= 0.95
"""Forces count over this share of the insertion, as in I."""
POST_AOS = COUNTED & (LAMBDA >= 7.0 / FULL_DEPTH_MM)
"""From where the stylet starts (08 section 5)."""

WELL_REGISTERED = (
    "backend.options.anatomy.entry_in_base_mm=[172.45, 4.85]",
    "backend.options.anatomy.insertion_angle_rad=0.2094",
    "backend.options.array.grip_angle_rad=0.0",
    "backend.options.array.curvature_error=0.0",
    "backend.options.trial.scatter=true",
)
"""What planar-sim errs by on purpose is taken out; what is left is the scatter of the specimens' tables."""
AS_THE_SOURCES = (
    f"workflow.depth_mm={FULL_DEPTH_MM}",
    "stylet.speed_mm_per_s=20.0",
    "trajectory.speed_rad_per_s=2.0",
    "trajectory.acceleration_rad_per_s2=20.0",
    "trajectory.jerk_rad_per_s3=400.0",
    "safety.force_limit_n=5.0",
    "workflow.hold_s=0.1",
)
"""Full depth as in the sources, no limit of the machine in the way, and nobody who stops at half a newton."""
NO_CONTROL = ("admittance.lateral=false", "admittance.stylet=false")


@dataclass(frozen=True)
class Insertion:
    """One insertion over LAMBDA (m,); NaN beyond where it ended early.

    Attributes:
        axial_n, lateral_n: measured resistance and lateral force (m,).
        correction_mm: of the path at the end, to the left of the insertion axis.
        largest_correction_mm: in any direction.
        folded, buckled: what became of the array, as truth.
        failed: why it did not reach its end, empty if it did.
        drawn: what the seed decided, by names with units.
    """

    axial_n: np.ndarray
    lateral_n: np.ndarray
    correction_mm: float
    largest_correction_mm: float
    folded: bool
    buckled: bool
    failed: str
    drawn: dict[str, float]


def insert(settings: Settings, plan: Plan, seed: int) -> Insertion:
    """Simulate one insertion; one that fails is told of, not raised. plan: of :func:`rtctl.planner.plan_of`."""
    result = simulate(settings, seed, plan=plan)
    recording = result.recording
    rows = recording.records[recording.insertion]
    failed = "" if result.failure is None else str(result.failure)
    if len(rows) < 2 or recording.truths is None or recording.plan is None:
        nothing = np.full(LAMBDA.size, np.nan)
        return Insertion(nothing, nothing, np.nan, np.nan, False, False, failed or "not inserted", recording.drawn)
    share = rows["depth_mm"] / FULL_DEPTH_MM
    axial, lateral = (
        np.interp(LAMBDA, share, values, right=np.nan) for values in (-rows["force_axial_n"], rows["force_lateral_n"])
    )
    truths = recording.truths[np.isin(recording.truths["tick"], rows["tick"])]
    offset, axis = rows["admittance_offset_mm"], recording.plan["insertion_axis_in_base"][0]
    return Insertion(
        axial,
        lateral,
        correction_mm=float(offset[-1, 1] * axis[0] - offset[-1, 0] * axis[1]),
        largest_correction_mm=float(np.linalg.norm(offset, axis=1).max()),
        folded=bool(truths["folded"][-1]),
        buckled=bool(truths["buckled"].any()),
        failed=failed,
        drawn=recording.drawn,
    )


class Insertions:
    """Several of them.

    Attributes:
        each: the insertions, n of them.
        axial_n, lateral_n: (n, m).
        folded, buckled, ended_early: (n,).
        correction_mm, largest_correction_mm: (n,).
    """

    def __init__(self, each: Iterable[Insertion]) -> None:
        self.each = list(each)
        self.axial_n = np.array([i.axial_n for i in self.each])
        self.lateral_n = np.array([i.lateral_n for i in self.each])
        self.folded = np.array([i.folded for i in self.each])
        self.buckled = np.array([i.buckled for i in self.each])
        self.ended_early = np.array([bool(i.failed) for i in self.each])
        self.correction_mm = np.array([i.correction_mm for i in self.each])
        self.largest_correction_mm = np.array([i.largest_correction_mm for i in self.each])

    @property
    def inserted(self) -> np.ndarray:
        """Which of them (n,) got anywhere: the others have no forces."""
        return np.isfinite(self.axial_n[:, COUNTED]).any(axis=1)

    def mean_n(self) -> np.ndarray:
        """Mean resistance of every insertion (k,) that got anywhere."""
        return np.nanmean(self.axial_n[self.inserted][:, COUNTED], axis=1)

    def post_aos_n(self) -> np.ndarray:
        """Mean resistance from 7 mm on (k,), of those that got there."""
        part = self.axial_n[:, POST_AOS]
        return np.nanmean(part[np.isfinite(part).any(axis=1)], axis=1)

    def peak_n(self) -> np.ndarray:
        """Largest resistance of every insertion (k,) that got anywhere."""
        return np.nanmax(self.axial_n[self.inserted][:, COUNTED], axis=1)

    def lateral_mean_n(self) -> np.ndarray:
        """Mean lateral force of every insertion (k,) that got anywhere."""
        return np.nanmean(self.lateral_n[self.inserted][:, COUNTED], axis=1)
