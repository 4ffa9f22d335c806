"""How good a detector is on insertions it has not been trained with, and how good its method is at all."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rtctl.guidance import buckling, folding
from rtctl.guidance.dataset import BUCKLE, CLASSES, FOLD, NORMAL, Dataset
from rtctl.guidance.detector_file import Detector
from rtctl.guidance.features import GRID, Standard, regional, sampled
from rtctl.guidance.force_model import AOS_START, FULL_DEPTH_MM
from rtctl.guidance.svm import decide, linear_kernel, rbf_kernel, solve

HELD_OUT = 0.1
"""Share of the insertions a split keeps for the test."""
METHODS = {
    1: "linear, f_z",
    2: "linear, f_z, f_xx, f_yy",
    3: "rbf, κ4, η4",
    4: "rbf, κ1..4, η1..4",
}
"""Table VI.4."""
RBF = {3: (0.25, 1.23), 4: (2.11, 2.63)}
"""sigma and C of the rbf methods."""


@dataclass(frozen=True)
class Evaluation:
    """What a detector makes of insertions.

    Attributes:
        margin: rho.
        confusion: class -> how many insertions, flagged as a fold, flagged as buckling, flagged as neither.
        false_positives: share of the normal insertions flagged as a fold.
        false_negatives: share of the folds not flagged as one.
        accuracy: share of normal and folding insertions that are judged rightly.
        onset_mm: depth (folds flagged,) of each fold's first flag.
        early_share: share of them before the stylet is held back.
        buckling_false_positives: share of the normal insertions flagged as buckling.
        buckling_detected: share of the buckling insertions flagged as such.
    """

    margin: float
    confusion: dict[str, dict[str, int]]
    false_positives: float
    false_negatives: float
    accuracy: float
    onset_mm: list[float]
    early_share: float
    buckling_false_positives: float
    buckling_detected: float

    @property
    def median_onset_mm(self) -> float:
        """Middle depth of the first flags, NaN if there is none."""
        return float(np.median(self.onset_mm)) if self.onset_mm else float("nan")

    def as_table(self) -> dict[str, Any]:
        """Plain data; unknown is None."""
        table = asdict(self) | {"median_onset_mm": self.median_onset_mm}
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in table.items()}


def evaluate(detector: Detector, data: Dataset, margins: Sequence[float], two_sided: bool = False) -> list[Evaluation]:
    """Run the detector over every insertion of a data set, sample by sample, as the tick would: once for each margin."""
    early = detector.folding.decide_early(detector.forces, data.profiles)
    buckled = buckling.detected(detector.buckling, data.profiles, two_sided) >= 0
    return [_judge(data, margin, detector.folding.detected(early, margin), buckled) for margin in margins]


def _judge(data: Dataset, margin: float, known: np.ndarray, buckled: np.ndarray) -> Evaluation:
    """Figures from the number of known samples at which each insertion (n,) was flagged, and whether it buckled."""
    folded = known > 0
    is_class = {name: data.classes == name for name in CLASSES}
    confusion = {
        name: {
            "insertions": int(at.sum()),
            "fold": int((at & folded).sum()),
            "buckling": int((at & buckled).sum()),
            "neither": int((at & ~folded & ~buckled).sum()),
        }
        for name, at in is_class.items()
    }
    normal, fold = is_class[NORMAL], is_class[FOLD]
    onset = GRID[known[fold & folded] - 1]
    return Evaluation(
        margin,
        confusion,
        _share(folded[normal]),
        _share(~folded[fold]),
        _share(np.concatenate([~folded[normal], folded[fold]])),
        (onset * FULL_DEPTH_MM).tolist(),
        _share(onset < AOS_START),
        _share(buckled[normal]),
        _share(buckled[is_class[BUCKLE]]),
    )


def cross_validate(data: Dataset, method: int, splits: int, seed: int) -> np.ndarray:
    """Accuracy (splits,) of a method on whole insertions: trained on 90 % of normal and folding ones, tested on the rest.

    Features are standardised by the training part. Splits are drawn from `seed`, the same for every method.

    Raises:
        TrainingError: a class is missing.
    """
    random = np.random.default_rng(seed)
    normal, fold = data.of(NORMAL), data.of(FOLD)
    profiles = np.concatenate([normal, fold])
    labels = np.repeat([folding.NORMAL, folding.FOLDED], [len(normal), len(fold)])
    features = _features(profiles, method)
    held_out = max(1, round(HELD_OUT * len(labels)))
    accuracy = np.zeros(splits)
    for i in range(splits):
        order = random.permutation(len(labels))
        test, training = order[:held_out], order[held_out:]
        accuracy[i] = _accuracy(features, labels, training, test, method)
    return accuracy


def _features(profiles: np.ndarray, method: int) -> np.ndarray:
    if method in folding.CHANNEL_COUNTS:
        return sampled(profiles, folding.CHANNEL_COUNTS[method])
    return regional(profiles)[:, [3, 7]] if method == 3 else regional(profiles)


def _accuracy(features: np.ndarray, labels: np.ndarray, training: np.ndarray, test: np.ndarray, method: int) -> float:
    phi = Standard.of(features[training]).apply(features)
    if method in RBF:
        sigma, limit = RBF[method]
        matrix = rbf_kernel(phi[training], phi, sigma)
    else:
        limit = folding.LIMITS[method]
        matrix = linear_kernel(phi[training], phi)
    h = decide(solve(matrix[:, training], labels[training], limit), labels[training], matrix[:, test])
    return float(np.mean(np.where(h >= 0.0, folding.NORMAL, folding.FOLDED) == labels[test]))


def _share(flags: np.ndarray) -> float:
    return float(np.mean(flags)) if len(flags) else float("nan")
