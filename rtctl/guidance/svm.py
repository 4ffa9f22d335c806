"""Support vector machine for two classes (D VI.13 to VI.17, corrected as in 03 section 5), solved by SMO.

Sequential minimal optimisation with the second-order choice of the pair (Fan, Chen and Lin, 2005). Training sets here have
a hundred insertions, not millions, so the whole kernel matrix is at hand and nothing is cached or shrunk.
"""

from dataclasses import dataclass

import numpy as np

from hal.errors import RtctlError

TOLERANCE = 1e-6
"""Largest violation of the optimality conditions left [units of h]."""
STEP_LIMIT = 1_000_000
SMALLEST_CURVATURE = 1e-12


class TrainingError(RtctlError):
    """No detector can be made of these insertions."""

    exit_code = 6


@dataclass(frozen=True)
class Dual:
    """Solution of the dual problem (VI.15): multipliers (n,) in [0, C], and the bias of h."""

    multipliers: np.ndarray
    bias: float


def linear_kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """k(a, b) = a b^T of rows (n, d) and (m, d): (n, m) (VI.16)."""
    return a @ b.T


def rbf_kernel(a: np.ndarray, b: np.ndarray, sigma: float) -> np.ndarray:
    """k(a, b) = exp(-|a - b|^2 / 2 sigma^2) of rows (n, d) and (m, d): (n, m) (VI.17, norm squared)."""
    squares = ((a[:, None] - b[None]) ** 2).sum(axis=2)
    return np.exp(-squares / (2.0 * sigma**2))


def solve(kernel: np.ndarray, labels: np.ndarray, limit: float) -> Dual:
    """Maximise sum alpha_i - 1/2 sum alpha_i alpha_j y_i y_j k_ij with 0 <= alpha <= C and sum alpha_i y_i = 0.

    Args:
        kernel: matrix (n, n) of k(v_i, v_j).
        labels: y (n,), -1 or 1, both present.
        limit: C.

    Raises:
        TrainingError: one class only, or no convergence (numbers that are not finite).
    """
    y = labels.astype(float)
    if not {-1.0, 1.0} == set(y.tolist()):
        raise TrainingError("two classes are needed to separate", value=sorted(set(y.tolist())), bound="-1 and 1")
    alpha = np.zeros(len(y))
    gradient = -np.ones(len(y))  # of the dual to be minimised: Q alpha - 1, Q_ij = y_i y_j k_ij
    diagonal = np.diag(kernel)
    for _ in range(STEP_LIMIT):
        pull = -y * gradient
        rises = np.where(y > 0, alpha < limit, alpha > 0)
        falls = np.where(y > 0, alpha > 0, alpha < limit)
        i = int(np.where(rises, pull, -np.inf).argmax())
        gap = pull[i] - pull
        if not np.isfinite(gap).all():
            break
        if np.where(falls, gap, -np.inf).max() < TOLERANCE:
            return Dual(alpha, _bias(alpha, pull, rises, falls, limit))
        curvature = np.maximum(diagonal[i] + diagonal - 2.0 * kernel[i], SMALLEST_CURVATURE)
        gain = np.where(falls & (gap > 0), gap**2 / curvature, -np.inf)
        j = int(gain.argmax())
        # along y_i alpha_i + y_j alpha_j = const, as far as the optimum or the box
        room_i = limit - alpha[i] if y[i] > 0 else alpha[i]
        room_j = alpha[j] if y[j] > 0 else limit - alpha[j]
        step = min(gap[j] / curvature[j], room_i, room_j)
        for at, sign, room in ((i, 1.0, room_i), (j, -1.0, room_j)):
            end = limit if y[at] * sign > 0 else 0.0
            alpha[at] = end if step == room else alpha[at] + sign * y[at] * step
        gradient += y * step * (kernel[i] - kernel[j])
    raise TrainingError("the support vector machine does not converge", remedy="look for numbers that are not finite or far out in the training set")  # fmt: skip


def decide(dual: Dual, labels: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """h = sum alpha_i y_i k(v_i, v) + b (VI.14) of rows (m,) whose kernel with the training set is `kernel` (n, m)."""
    return (dual.multipliers * labels) @ kernel + dual.bias


def _bias(alpha: np.ndarray, pull: np.ndarray, rises: np.ndarray, falls: np.ndarray, limit: float) -> float:
    """Mean over the support vectors on the margin; without any, the middle of what the conditions allow."""
    free = (alpha > 0) & (alpha < limit)
    if free.any():
        return float(pull[free].mean())
    return float((pull[rises].max() + pull[falls].min()) / 2.0)
