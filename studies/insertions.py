"""Many simulated insertions and their force curves over depth, for studies: fixed seeds, all cores, progress."""

import os
from collections.abc import Hashable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context

import numpy as np

from rtctl.electrode.planning import Plan
from rtctl.planner import plan_of
from rtctl.settings import Settings, load
from rtctl.simulation import simulate

FULL_DEPTH_MM = 13.8
"""lambda = 1 (D section V.1)."""
LAMBDA = np.linspace(0.0, 1.0, 139)
COUNTED = 0.95
"""Forces count over this share of the insertion, as in I."""
AOS_LAMBDA = 7.0 / FULL_DEPTH_MM

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
class Insertions:
    """n insertions over LAMBDA (m,); NaN beyond where one ended early.

    axial_n, lateral_n: measured resistance and lateral force (n, m).
    folded, buckled: what became of the array, as truth (n,).
    failed: why a run did not reach its end, empty if it did (n,).
    """

    axial_n: np.ndarray
    lateral_n: np.ndarray
    folded: np.ndarray
    buckled: np.ndarray
    correction_mm: np.ndarray
    failed: list[str]

    @property
    def counted(self) -> np.ndarray:
        """Which of LAMBDA count."""
        return LAMBDA <= COUNTED

    def mean_n(self) -> np.ndarray:
        """Mean resistance of every insertion (n,)."""
        return np.nanmean(self.axial_n[:, self.counted], axis=1)

    def post_aos_n(self) -> np.ndarray:
        """Mean resistance from 7 mm on (n,)."""
        return np.nanmean(self.axial_n[:, self.counted & (LAMBDA >= AOS_LAMBDA)], axis=1)

    def peak_n(self) -> np.ndarray:
        """Largest resistance of every insertion (n,)."""
        return np.nanmax(self.axial_n[:, self.counted], axis=1)

    def lateral_mean_n(self) -> np.ndarray:
        """Mean lateral force of every insertion (n,)."""
        return np.nanmean(self.lateral_n[:, self.counted], axis=1)


class Laboratory:
    """Runs insertions with settings on top of `planar-sim`, in as many processes as there are cores."""

    def __init__(self, jobs: int | None = None) -> None:
        self._pool = ProcessPoolExecutor(jobs or os.cpu_count() or 1, get_context("spawn"))
        self._plans: dict[Hashable, Plan] = {}

    def insert(self, overrides: Iterable[str], seeds: Iterable[int]) -> Insertions:
        """One insertion for every seed."""
        settings = load("planar-sim", overrides)
        models = settings.electrode, settings.cochlea
        if models not in self._plans:
            self._plans[models] = plan_of(settings)
        rows = list(self._pool.map(partial(curves, settings, self._plans[models]), seeds))
        axial, lateral, folded, buckled, correction, failed = zip(*rows, strict=True)
        return Insertions(
            np.array(axial), np.array(lateral), np.array(folded), np.array(buckled), np.array(correction), list(failed)
        )

    def close(self) -> None:
        """End the processes."""
        self._pool.shutdown(cancel_futures=True)


def curves(settings: Settings, plan: Plan, seed: int) -> tuple[np.ndarray, np.ndarray, bool, bool, float, str]:
    """Force curves (m,) of one insertion, fold and buckle, largest lateral correction [mm], and why it ended early."""
    result = simulate(settings, seed, plan=plan)
    recording = result.recording
    rows = recording.records[recording.insertion]
    nothing = np.full(LAMBDA.size, np.nan)
    failed = "" if result.failure is None else str(result.failure)
    if len(rows) < 2 or recording.truths is None:
        return nothing, nothing, False, False, np.nan, failed or "not inserted"
    share = rows["depth_mm"] / FULL_DEPTH_MM
    axial, lateral = (
        np.interp(LAMBDA, share, values, right=np.nan) for values in (-rows["force_axial_n"], rows["force_lateral_n"])
    )
    truths = recording.truths[np.isin(recording.truths["tick"], rows["tick"])]
    correction = float(np.linalg.norm(rows["admittance_offset_mm"], axis=1).max())
    return axial, lateral, bool(truths["folded"][-1]), bool(truths["buckled"].any()), correction, failed
