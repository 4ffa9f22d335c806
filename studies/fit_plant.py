"""Fit the plant once: to set 0 (phantom) and set 0b (bone) of Table VI.3 and to the mean force of Table V.2.

    python -m studies.fit_plant             about ten minutes on two cores
    python -m studies.fit_plant --check     only the residuals with the parameters that ship

Free are, within the ranges of 08 section 4, friction and floor load of the phantom and the curvature of the array, and
then, for the bone, its friction and how late the stylet starts. Everything else stays at its start value, and the
planner's model is the calibration of the very array that is tried (`studies.free_shapes`). What is fitted are means over
scattered insertions with fixed seeds, without any force control; what is predicted is in `studies.predict`.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from rtctl.guidance.force_model import resistance
from rtctl.study.insertions import (
    AS_THE_SOURCES,
    COUNTED,
    FULL_DEPTH_MM,
    LAMBDA,
    NO_CONTROL,
    WELL_REGISTERED,
    Insertions,
)
from sim_backends.plant.options import Array, Bone, Phantom
from studies.free_shapes import modal_model
from studies.laboratory import Laboratory

SENSOR_FLOOR_N = 0.004
"""beta: no deviation of the reference is taken to be smaller (03 section 1)."""
TARGETS = {
    "phantom": {"mean": (0.042, 0.01), "peak": (0.190, 0.04), "lateral": (0.016, 0.01)},
    "bone": {"mean": (0.071, 0.02), "peak": (0.284, 0.06)},
}
"""Value and accepted deviation [N] of sets 0 and 0b (08 section 5.9)."""
STATIC = 1.05
"""Static over kinetic friction: within 1.0 to 1.1, or the array sticks and slips."""
SEEDS = {"phantom": range(1000, 1020), "bone": range(2000, 2020)}
PHANTOM = (("friction", 0.05, 0.5), ("floor_load_n_per_mm", 0.0, 0.06), ("curvature_tip_per_mm", 0.7, 1.3), ("curvature_base_per_mm", 0.05, 0.2))  # fmt: skip
BONE = (("friction", 0.05, 0.5), ("stylet_late_mm", 0.0, 1.5))
TOLERANCE = 0.01
EVALUATIONS = {"phantom": 70, "bone": 35}


def overrides(specimen: str, values: dict[str, float]) -> list[str]:
    """Settings of a specimen with `values` of its parameters, and of the array's."""
    curvature = {name: value for name, value in values.items() if name.startswith("curvature")}
    matrix, _ = modal_model(replace(Array(), **curvature))  # type: ignore[arg-type]
    tissue = {name: value for name, value in values.items() if name not in curvature}
    if "friction" in tissue:
        tissue["friction_static"] = STATIC * tissue["friction"]
    return [
        *WELL_REGISTERED,
        *AS_THE_SOURCES,
        *NO_CONTROL,
        f"backend.options.trial.specimen={specimen}",
        f"electrode.modal_matrix={matrix.tolist()}",
        *(f"backend.options.array.{name}={value}" for name, value in curvature.items()),
        *(f"backend.options.{specimen}.{name}={value}" for name, value in tissue.items()),
    ]


def figures(insertions: Insertions) -> dict[str, float]:
    """Means over the insertions [N]."""
    return {
        "mean": float(insertions.mean_n().mean()),
        "peak": float(insertions.peak_n().mean()),
        "lateral": float(insertions.lateral_mean_n().mean()),
    }


def against_table(insertions: Insertions) -> np.ndarray:
    """Mean force over depth less that of Table V.2, in standard deviations of Table V.2, where it counts."""
    mean, deviation = resistance(LAMBDA[COUNTED] * FULL_DEPTH_MM)
    return (np.nanmean(insertions.axial_n[:, COUNTED], axis=0) - mean) / np.maximum(deviation, SENSOR_FLOOR_N)


def misfit(specimen: str, insertions: Insertions) -> float:
    """Squared deviations from the targets in their accepted bands; for the phantom, those from the curve too."""
    found = figures(insertions)
    sum_of_squares = sum(((found[name] - value) / band) ** 2 for name, (value, band) in TARGETS[specimen].items())
    if specimen == "phantom":
        z = against_table(insertions)
        sum_of_squares += float(np.mean(z**2) + 10.0 * np.mean(np.maximum(np.abs(z) - 1.0, 0.0) ** 2))
    return sum_of_squares


def tell(specimen: str, insertions: Insertions) -> None:
    """Print targets, what came out, and the residuals."""
    found = figures(insertions)
    for name, value in found.items():
        target, band = TARGETS[specimen].get(name, (float("nan"), float("nan")))
        met = "" if np.isnan(target) else ("met" if abs(value - target) <= band else "NOT met")
        print(f"  {name:8s} {1e3 * value:6.1f} mN, target {1e3 * target:5.0f} +- {1e3 * band:.0f}  {met}")
    print(f"  post-AOS {1e3 * insertions.post_aos_n().mean():6.1f} mN, SD of the mean force {1e3 * insertions.mean_n().std(ddof=1):.1f} mN")  # fmt: skip
    print(f"  folded {insertions.folded.sum()}, buckled {insertions.buckled.sum()}, ended early {insertions.ended_early.sum()} of {len(insertions.each)}")  # fmt: skip
    if specimen == "phantom":
        z = against_table(insertions)
        inside = np.mean(np.abs(z) <= 1.0)
        print(f"  Table V.2: within one SD over {100 * inside:.0f} % of the depth, rms {np.sqrt(np.mean(z**2)):.2f} SD, worst {z[np.argmax(np.abs(z))]:+.2f} SD at lambda {LAMBDA[: len(z)][np.argmax(np.abs(z))]:.2f}")  # fmt: skip


def fit(
    laboratory: Laboratory, specimen: str, names: tuple[str, ...], start: np.ndarray, fixed: dict[str, float],
    bounds: list[tuple[float, float]], report: Callable[[str], None],
) -> dict[str, float]:  # fmt: skip
    """The parameters of least misfit by Nelder and Mead's method."""
    count = 0

    def cost(x: np.ndarray) -> float:
        nonlocal count
        count += 1
        values = fixed | dict(zip(names, map(float, x), strict=True))
        value = misfit(specimen, laboratory.insert(overrides(specimen, values), SEEDS[specimen]))
        report(f"{specimen} {count:3d}: " + ", ".join(f"{v:.4g}" for v in x) + f" -> {value:.3f}")
        return value

    simplex = np.vstack([start, *(start + 0.25 * (h - lo) * np.eye(len(start))[k] * (1 if start[k] + 0.25 * (h - lo) <= h else -1) for k, (lo, h) in enumerate(bounds))])  # fmt: skip
    options: Any = {"maxfev": EVALUATIONS[specimen], "fatol": TOLERANCE, "xatol": 1e-3, "initial_simplex": simplex}
    found = minimize(cost, start, method="Nelder-Mead", bounds=bounds, options=options)
    return dict(zip(names, map(float, found.x), strict=True))


def main(arguments: list[str] | None = None) -> int:
    """Fit or check, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only the residuals of the parameters that ship")
    only_check = parser.parse_args(arguments).check
    laboratory = Laboratory()
    say = lambda text: print(text, file=sys.stderr, flush=True)  # noqa: E731
    phantom = {name: getattr(Phantom() if hasattr(Phantom(), name) else Array(), name) for name, _, _ in PHANTOM}
    bone = {name: getattr(Bone(), name) for name, _, _ in BONE}
    for specimen, values, ranges in (("phantom", phantom, PHANTOM), ("bone", bone, BONE)):
        names, bounds = tuple(n for n, _, _ in ranges), [(low, high) for _, low, high in ranges]
        fixed = {} if specimen == "phantom" else {k: v for k, v in phantom.items() if k != "friction"}
        if not only_check:
            start = np.array([values[name] for name in names])
            values |= fit(laboratory, specimen, names, start, fixed, bounds, say)
        print(f"{specimen}: " + ", ".join(f"{name} {value:.4g}" for name, value in values.items()))
        tell(specimen, laboratory.insert(overrides(specimen, fixed | values), SEEDS[specimen]))
    laboratory.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
