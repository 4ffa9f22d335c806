"""Buckling outside the cochlea by two integrals over depth (D VI.10 to VI.12, corrected as in 03 section 4)."""

from dataclasses import dataclass

import numpy as np

from rtctl.guidance.features import GRID
from rtctl.guidance.force_model import FLOOR

DEVIATIONS = 3.0
"""N: so many standard deviations of normal insertions are normal (99.7 %, not the 95 % printed)."""


@dataclass(frozen=True)
class BucklingModel:
    """Integrals of normal insertions: mean and standard deviation (ddof = 1), (2, 97) each [N, N mm]."""

    mean: np.ndarray
    deviation: np.ndarray


def integrals(profiles: np.ndarray) -> np.ndarray:
    """phi_1 = -int f_z dlambda and phi_2 = int sqrt(f_xx^2 + f_yy^2) dlambda of profiles (n, 3, 97): (n, 2, 97).

    By the trapezoidal rule from sample to sample, 0 at the first.
    """
    rates = np.stack([-profiles[:, 0], np.hypot(profiles[:, 1], profiles[:, 2])], axis=1)
    steps = 0.5 * (rates[..., 1:] + rates[..., :-1]) * np.diff(GRID)
    return np.concatenate([np.zeros((*rates.shape[:2], 1)), np.cumsum(steps, axis=2)], axis=2)


def train(normal: np.ndarray) -> BucklingModel:
    """Thresholds from normal insertions (n, 3, 97).

    No deviation is smaller than what an offset of the sensor's floor beta would make of the integral, beta lambda: at first
    normal insertions differ by less than the sensor can tell, and its noise would be a failure.
    """
    phi = integrals(normal)
    floor = np.outer(FLOOR[:2], GRID)
    return BucklingModel(phi.mean(axis=0), np.maximum(phi.std(axis=0, ddof=1), floor))


def detected(model: BucklingModel, profiles: np.ndarray, two_sided: bool = False) -> np.ndarray:
    """Number of the sample at which both integrals have left the normal region, -1 if never: (n,).

    One-sided: only larger ones count. Each is latched by itself, as they need not leave at the same time.
    """
    away = integrals(profiles) - model.mean
    if two_sided:
        away = np.abs(away)
    latched: np.ndarray = np.logical_or.accumulate(away > DEVIATIONS * model.deviation, axis=2)
    outside = latched[:, 0] & latched[:, 1]
    return np.where(outside.any(axis=1), outside.argmax(axis=1), -1)
