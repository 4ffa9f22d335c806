"""Support vector machine for two classes (D VI.13 to VI.17, corrected as in 03 section 5), solved by SMO.

Sequential minimal optimisation with the second-order choice of the pair (Fan, Chen and Lin, 2005). Training sets here have
a hundred insertions, not millions, so the whole kernel matrix is at hand and nothing is cached or shrunk. Decision 14 says
why this is not a library.
"""

from dataclasses import dataclass

import numpy as np

from hal.errors import RtctlError
from hal.kernel import kernel

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


def solve(matrix: np.ndarray, labels: np.ndarray, limit: float) -> Dual:
    """Maximise sum alpha_i - 1/2 sum alpha_i alpha_j y_i y_j k_ij with 0 <= alpha <= C and sum alpha_i y_i = 0.

    Args:
        matrix: k(v_i, v_j), (n, n).
        labels: y (n,), -1 or 1, both present.
        limit: C.

    Raises:
        TrainingError: one class only, or no convergence (numbers that are not finite).
    """
    y = labels.astype(float)
    if set(y.tolist()) != {-1.0, 1.0}:
        raise TrainingError("two classes are needed to separate", value=sorted(set(y.tolist())), bound="-1 and 1")
    if not np.isfinite(matrix).all():
        raise TrainingError("the training set holds numbers that are not finite", remedy="look at its profiles")
    alpha = np.zeros(len(y))
    pull = y.copy()
    if not _optimise(np.ascontiguousarray(matrix), y, limit, alpha, pull):
        raise TrainingError("the support vector machine does not converge", value=STEP_LIMIT, bound="steps", remedy="look for forces that are far out")  # fmt: skip
    return Dual(alpha, _bias(alpha, pull, y, limit))


@kernel
def _optimise(matrix, y, limit, alpha, pull):
    """Pairs of multipliers, one after the other, until none violates the optimality conditions by `TOLERANCE`.

    `pull` is -y times the gradient of the dual to be minimised: where it is larger, a multiplier along y wants to rise.
    Changes `alpha` and `pull` in place. True if it converged.
    """
    n = y.shape[0]
    for _ in range(STEP_LIMIT):
        i = -1
        for t in range(n):
            may_rise = alpha[t] < limit if y[t] > 0.0 else alpha[t] > 0.0
            if may_rise and (i < 0 or pull[t] > pull[i]):
                i = t
        j, best, widest = -1, 0.0, 0.0
        for t in range(n):
            may_fall = alpha[t] > 0.0 if y[t] > 0.0 else alpha[t] < limit
            gap = pull[i] - pull[t]
            if may_fall and gap > 0.0:
                widest = max(widest, gap)
                gain = gap * gap / max(matrix[i, i] + matrix[t, t] - 2.0 * matrix[i, t], SMALLEST_CURVATURE)
                if gain > best:
                    j, best = t, gain
        if widest < TOLERANCE:
            return True
        # along y_i alpha_i + y_j alpha_j = const, as far as the optimum or the box
        curvature = max(matrix[i, i] + matrix[j, j] - 2.0 * matrix[i, j], SMALLEST_CURVATURE)
        room_i = limit - alpha[i] if y[i] > 0.0 else alpha[i]
        room_j = alpha[j] if y[j] > 0.0 else limit - alpha[j]
        step = min((pull[i] - pull[j]) / curvature, room_i, room_j)
        if step == room_i:
            alpha[i] = limit if y[i] > 0.0 else 0.0  # exactly: who is on the box must be seen to be
        else:
            alpha[i] += y[i] * step
        if step == room_j:
            alpha[j] = 0.0 if y[j] > 0.0 else limit
        else:
            alpha[j] -= y[j] * step
        for t in range(n):
            pull[t] -= step * (matrix[i, t] - matrix[j, t])
    return False


def decide(dual: Dual, labels: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """h = sum alpha_i y_i k(v_i, v) + b (VI.14), (m,), of vectors whose kernel with the training set is `matrix` (n, m)."""
    return (dual.multipliers * labels) @ matrix + dual.bias


def _bias(alpha: np.ndarray, pull: np.ndarray, y: np.ndarray, limit: float) -> float:
    """Mean over the support vectors on the margin; without any, the middle of what the conditions allow."""
    free = (alpha > 0) & (alpha < limit)
    if free.any():
        return float(pull[free].mean())
    rises = np.where(y > 0, alpha < limit, alpha > 0)
    return float((pull[rises].max() + pull[~rises].min()) / 2.0)
