"""Tip folding by a linear SVM on the predicted profile, with the margin rho (D VI.20 to VI.27, 03 sections 5 and 6).

Normal is h >= 0. Of an insertion under way the first k samples are known; the features after them are predicted, and h may
be wrong by as much as delta h because of that.
"""

from dataclasses import dataclass

import numpy as np

from rtctl.guidance.features import FEATURE_SAMPLES, GRID, SAMPLES, Standard, sampled
from rtctl.guidance.force_model import ForceModel, basis
from rtctl.guidance.prediction import predict
from rtctl.guidance.svm import linear_kernel, solve

LIMITS = {1: 1.24, 2: 1.05}
"""C of methods 1 and 2 (Table VI.4)."""
CHANNEL_COUNTS = {1: 1, 2: 3}
"""Channels each looks at: f_z; f_z, f_xx and f_yy."""
KNOWN = np.arange(8, SAMPLES, 2)
"""Numbers of known samples k at which a decision is made."""
NORMAL, FOLDED = 1, -1


@dataclass(frozen=True)
class FoldModel:
    """A trained classifier.

    Attributes:
        method: 1 or 2.
        standard: of the features.
        weight: w (d,) on standardised features.
        bias: b.
        bound: delta h (len(KNOWN),) for each number of known samples, before rho.
    """

    method: int
    standard: Standard
    weight: np.ndarray
    bias: float
    bound: np.ndarray

    @property
    def channels(self) -> int:
        """Channels it looks at."""
        return CHANNEL_COUNTS[self.method]

    def decide(self, profiles: np.ndarray) -> np.ndarray:
        """h (n,) of whole, or completed, profiles (n, 3, 97) (VI.21)."""
        return self.standard.apply(sampled(profiles, self.channels)) @ self.weight + self.bias

    def decide_early(self, force_model: ForceModel, profiles: np.ndarray) -> np.ndarray:
        """h (n, len(KNOWN)) for each number of known samples."""
        return np.stack([self.decide(completed(force_model, profiles, k)) for k in KNOWN.tolist()], axis=1)

    def detected(self, early: np.ndarray, margin: float) -> np.ndarray:
        """Number of known samples at which h + rho delta h <= 0 for the first time, -1 if never: (n,) (VI.27).

        early: h of :meth:`decide_early`.
        """
        folded = early + margin * self.bound <= 0.0
        return np.where(folded.any(axis=1), KNOWN[folded.argmax(axis=1)], -1)


def completed(force_model: ForceModel, profiles: np.ndarray, known: int) -> np.ndarray:
    """Profiles (n, 3, 97) with everything after the first `known` samples replaced by its prediction."""
    predicted = predict(force_model, GRID, profiles[..., :known]) @ basis(GRID[known:]).T
    return np.concatenate([profiles[..., :known], predicted], axis=2)


def train(profiles: np.ndarray, labels: np.ndarray, force_model: ForceModel, method: int = 2) -> FoldModel:
    """Classifier and bound from profiles (n, 3, 97) with labels (n,) `NORMAL` or `FOLDED`.

    Raises:
        TrainingError: only one class, or numbers that are not finite.
    """
    channels = CHANNEL_COUNTS[method]
    features = sampled(profiles, channels)
    standard = Standard.of(features)
    phi = standard.apply(features)
    dual = solve(linear_kernel(phi, phi), labels, LIMITS[method])
    weight = (dual.multipliers * labels) @ phi
    return FoldModel(method, standard, weight, dual.bias, _bound(profiles, features, force_model, standard, weight))


def _bound(
    profiles: np.ndarray, features: np.ndarray, force_model: ForceModel, standard: Standard, weight: np.ndarray
) -> np.ndarray:
    """delta h = |w_f| |S^-1 eps_f|, rms over the training set, in standardised coordinates (VI.26).

    eps are predicted minus final features, f those sampled after the first k.
    """
    channels = features.shape[1] // len(FEATURE_SAMPLES)
    sample = np.tile(FEATURE_SAMPLES, channels)
    bound = np.zeros(len(KNOWN))
    for i, k in enumerate(KNOWN.tolist()):
        error = (sampled(completed(force_model, profiles, k), channels) - features) / standard.deviation
        bound[i] = np.linalg.norm(weight[sample >= k]) * np.sqrt((error**2).sum(axis=1).mean())
    return bound
