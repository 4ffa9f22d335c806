"""The named synthetic insertions SYN-1 (03 section 7): normal, folding and buckling force profiles from a seed.

They are made up: whatever is found with them is about the method, and is always reported as simulated.
"""

import numpy as np

from rtctl.guidance.features import GRID, SAMPLES
from rtctl.guidance.force_model import REFERENCE, basis

NAME = "SYN-1"
LENGTH = 0.2
"""Over this share of the depth the forces of one insertion stay related [lambda]."""
JITTER = 1e-9
SMALLEST_DEVIATION = 1e-4
NOISE = REFERENCE.floor / 4.0
FOLD = (0.20, 3.0)
"""A_z [N], A_m [N mm]: how much a fold adds at full depth."""
FOLD_ONSET = (0.55, 0.75)
BUCKLING_SLOPE = (-5.0, 80.0)
"""f_z [N] and f_xx [N mm] a unit of lambda after the onset."""
BUCKLING_ONSET = (0.2, 0.95)


def normal(count: int, random: np.random.Generator, length: float = LENGTH) -> np.ndarray:
    """Normal insertions (count, 3, 97): mean + deviation Z + noise, Z a unit Gaussian process of this correlation length."""
    distance = GRID[:, None] - GRID[None]
    covariance = np.exp(-(distance**2) / (2.0 * length**2)) + JITTER * np.eye(SAMPLES)
    process = random.standard_normal((count, 3, SAMPLES)) @ np.linalg.cholesky(covariance).T
    deviation = np.maximum(REFERENCE.deviation @ basis(GRID).T, SMALLEST_DEVIATION)
    noise = NOISE[:, None] * random.standard_normal((count, 3, SAMPLES))
    return REFERENCE.mean @ basis(GRID).T + deviation * process + noise


def folding(
    count: int, random: np.random.Generator, length: float = LENGTH, amplitude: tuple[float, float] = FOLD
) -> np.ndarray:
    """Insertions whose tip folds (count, 3, 97); each with an onset and a size of its own."""
    onset = random.uniform(*FOLD_ONSET, (count, 1))
    size = np.maximum(0.1, random.normal(1.0, 0.35, (count, 1)))
    since = np.clip((GRID - onset) / (1.0 - onset), 0.0, 1.0)
    rise = size * since**2 * (3.0 - 2.0 * since)
    direction = np.array([-amplitude[0], -amplitude[1], amplitude[1]])
    return normal(count, random, length) + direction[:, None] * rise[:, None]


def buckling(count: int, random: np.random.Generator, length: float = LENGTH) -> tuple[np.ndarray, np.ndarray]:
    """Insertions that buckle outside the cochlea (count, 3, 97), and the lambda (count,) where each begins to."""
    onset = random.uniform(*BUCKLING_ONSET, count)
    since = np.maximum(0.0, GRID - onset[:, None])
    profiles = normal(count, random, length)
    profiles[:, :2] += np.array(BUCKLING_SLOPE)[:, None] * since[:, None]
    return profiles, onset
