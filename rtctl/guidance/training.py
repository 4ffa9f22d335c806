"""From insertions of which the end is known to a detector."""

from datetime import UTC, datetime

import numpy as np

from rtctl.gateway.setup import revision
from rtctl.guidance import buckling, folding
from rtctl.guidance.dataset import FOLD, NORMAL, Dataset
from rtctl.guidance.detector_file import Detector
from rtctl.guidance.features import GRID, sampled
from rtctl.guidance.force_model import REFERENCE, fit
from rtctl.guidance.svm import TrainingError

FEWEST = 10
"""Insertions of a class without which its scatter is anybody's guess."""


def train(data: Dataset, *, method: int = 2, reference_forces: bool = False) -> Detector:
    """Force model, buckling thresholds, classifier and its bound from a data set.

    Args:
        method: 1 (f_z alone) or 2 (f_z, f_xx, f_yy).
        reference_forces: predict by Table V.2, which is right for SYN-1, instead of curves fitted to the normal insertions.

    Raises:
        TrainingError: too few normal or folding insertions, or a feature without scatter.
    """
    counts = data.counts()
    for name in (NORMAL, FOLD):
        if counts[name] < FEWEST:
            raise TrainingError(f"too few insertions of class {name}", value=counts[name], bound=f"at least {FEWEST}", remedy="add logs of such insertions")  # fmt: skip
    if not np.isfinite(data.profiles).all():
        raise TrainingError("a profile holds a number that is not finite", remedy="look at the logs")
    normal, fold = data.of(NORMAL), data.of(FOLD)
    forces = REFERENCE if reference_forces else fit(GRID, normal)
    profiles = np.concatenate([normal, fold])
    scatter = sampled(profiles, folding.CHANNEL_COUNTS[method]).std(axis=0)
    if (scatter <= 0.0).any():
        raise TrainingError("a feature is the same in all insertions", value=int(scatter.argmin()), bound="scatter", remedy="the force sensor may be dead; or use --method 1")  # fmt: skip
    labels = np.repeat([folding.NORMAL, folding.FOLDED], [len(normal), len(fold)])
    provenance = {
        "data": data.name,
        "digest": data.digest,
        "counts": counts,
        "forces": "Table V.2" if reference_forces else "fitted to the normal insertions",
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "revision": revision(),
    }
    return Detector(forces, folding.train(profiles, labels, forces, method), buckling.train(normal), provenance)
