"""What the classifiers look at (D VI.18 to VI.20, 03 section 5): forces sampled over depth, or figures of four regions.

Profiles are forces (n, channels, 97) of n insertions: f_z [N], f_xx, f_yy [N mm] at `GRID`.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rtctl.guidance.force_model import AOS_START, FULL_DEPTH_MM

SAMPLES = 97
GRID = np.linspace(0.0, 1.0, SAMPLES)
"""lambda of the samples of a profile."""
FEATURE_EVERY = 4
"""Every so many samples one is a feature: 25 a channel."""
FEATURE_SAMPLES = np.arange(0, SAMPLES, FEATURE_EVERY)
STIFFNESS_SCALE_N_PER_MM = 0.3
"""rho_s."""
REGIONS = (0.0, AOS_START / 2.0, AOS_START, (1.0 + AOS_START) / 2.0, 1.0)
"""lambda_0 .. lambda_4 (Fig. VI.9)."""


@dataclass(frozen=True)
class Standard:
    """Standardisation (VI.20): mean o and deviation S (ddof = 1) of every feature over the training set, (d,) each."""

    mean: np.ndarray
    deviation: np.ndarray

    @classmethod
    def of(cls, features: np.ndarray) -> "Standard":
        """From features (n, d), n >= 2."""
        return cls(features.mean(axis=0), features.std(axis=0, ddof=1))

    def apply(self, features: np.ndarray) -> np.ndarray:
        """S^-1 (v - o) of features (n, d)."""
        return (features - self.mean) / self.deviation


def sampled(profiles: np.ndarray, channels: int) -> np.ndarray:
    """Features of the linear methods: 25 samples of each of the first `channels` channels, (n, 25 channels)."""
    return profiles[:, :channels, FEATURE_SAMPLES].reshape(len(profiles), -1)


def regional(profiles: np.ndarray) -> np.ndarray:
    """kappa_1..4 and eta_1..4 of f_z in the four regions (VI.18 with q_max, VI.19): (n, 8)."""
    force = profiles[:, 0]
    fine = np.union1d(GRID, REGIONS)  # so that regions begin and end on a sample
    values = np.array([np.interp(fine, GRID, f) for f in force])
    at = np.searchsorted(fine, REGIONS)
    rise = np.diff(values[:, at], axis=1)
    stiffness = rise / (STIFFNESS_SCALE_N_PER_MM * FULL_DEPTH_MM * np.diff(REGIONS))
    work = np.array([np.trapezoid(values[:, a : b + 1], fine[a : b + 1], axis=1) for a, b in pairwise(at)])  # fmt: skip
    return np.hstack([stiffness, (work / work.sum(axis=0)).T])
