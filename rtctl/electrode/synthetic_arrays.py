"""Seven synthetic electrode arrays: curved, held straight by the stylet until it is withdrawn (spec 02 section 2).

They stand in for measured arrays; the modal matrices fitted to them are the models that ship.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from rtctl.electrode.array_shape import LENGTH_MM
from rtctl.electrode.calibration import calibrate

S_SAMPLES_MM = np.linspace(0.0, LENGTH_MM, 24)
STYLET_SAMPLES_MM = np.append(1.27 * np.arange(12), 15.0)


@dataclass(frozen=True)
class SyntheticArray:
    """Parameters of one array; curvatures in 1/mm.

    base_curvature, tip_curvature: k_b, k_t of the released array, quadratic in s between them.
    held_curvature: k_0 where the stylet still holds the array straight.
    release_width_mm: w, over which the stylet's end releases the array.
    offset_mm: l, of the stylet's end from the tip when it is fully in.
    base_angle_rad: theta_00 at the grip ribs.
    """

    base_curvature: float = 0.05
    tip_curvature: float = 1.0
    held_curvature: float = 0.012
    release_width_mm: float = 10.0
    offset_mm: float = 0.0
    base_angle_rad: float = 0.0

    def angle_rad(self, s_mm: np.ndarray, stylet_mm: np.ndarray) -> np.ndarray:
        """Bending angles (w, z) at arc lengths (w,) and stylet withdrawals (z,)."""
        s = np.linspace(0.0, LENGTH_MM, 721)
        free = self.base_curvature + (self.tip_curvature - self.base_curvature) * (s / LENGTH_MM) ** 2
        held = self._released(s, 0.0)
        columns = []
        for q in stylet_mm:
            share = (self._released(s, q) - held) / (1 - held)
            curvature = self.held_curvature + (free - self.held_curvature) * share
            turned = np.append(0.0, np.cumsum((curvature[1:] + curvature[:-1]) / 2 * np.diff(s)))
            columns.append(self.base_angle_rad + np.interp(s_mm, s, turned))
        return np.stack(columns, axis=1)

    def _released(self, s: np.ndarray, stylet_mm: float) -> np.ndarray:
        return 1 / (1 + np.exp(-4 * (s - (LENGTH_MM - self.offset_mm - stylet_mm)) / self.release_width_mm))


SYNTHETIC_ARRAYS = (
    SyntheticArray(),
    SyntheticArray(tip_curvature=0.90, base_curvature=0.08),
    SyntheticArray(tip_curvature=1.10, held_curvature=0.02),
    SyntheticArray(release_width_mm=11.0, offset_mm=0.5),
    SyntheticArray(held_curvature=0.02, tip_curvature=1.05, base_angle_rad=0.03),
    SyntheticArray(base_curvature=0.10, tip_curvature=0.85, base_angle_rad=-0.02),
    SyntheticArray(tip_curvature=1.15, offset_mm=-0.5, held_curvature=0.005),
)
"""Arrays 1 to 7 of the specification."""


@cache
def _calibrated() -> np.ndarray:
    samples = S_SAMPLES_MM, STYLET_SAMPLES_MM
    return np.stack([calibrate(*samples, array.angle_rad(*samples)) for array in SYNTHETIC_ARRAYS])


def modal_matrix(number: int = 1) -> np.ndarray:
    """Modal matrix A (4, 4) calibrated on synthetic array `number`, 1 to 7."""
    if not 1 <= number <= len(SYNTHETIC_ARRAYS):
        raise ValueError(f"synthetic arrays are numbered 1 to {len(SYNTHETIC_ARRAYS)}, not {number}")
    return _calibrated()[number - 1].copy()


def mean_modal_matrix() -> np.ndarray:
    """Mean modal matrix (4, 4) of the seven arrays: the guess for an array nobody has calibrated."""
    return _calibrated().mean(axis=0)
