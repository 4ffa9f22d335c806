"""Records of the detectors in the memory of the tick, and how a trained detector becomes one."""

import numpy as np

from rtctl.guidance.detector_file import Detector
from rtctl.guidance.features import FEATURE_SAMPLES, GRID, SAMPLES
from rtctl.guidance.folding import KNOWN
from rtctl.guidance.force_model import CHANNELS, FULL_DEPTH_MM
from rtctl.guidance.prediction import sums_dtype, tables_dtype, tabulate

WATCHING, BLIND, FORCE_HIGH, MOMENT_HIGH, BUCKLED, FOLDED = 1, 2, 4, 8, 16, 32
"""Bits of the signal `detector_flags`; all but the first are latched until the array is out again."""
WARN, PAUSE, RETRACT = 0, 1, 2
"""Reactions to a failure: tell; tell and pause once; pause, and nothing but a retraction until the array is out."""
REACTIONS = {"warn": WARN, "pause": PAUSE, "retract": RETRACT}
"""Their names in the settings."""

CHANNEL_COUNT, FEATURES = len(CHANNELS), len(FEATURE_SAMPLES)

DETECTOR = np.dtype(
    [
        ("on", "i8"),
        ("depth_mm", "f8", (SAMPLES,)),
        ("step", "f8"),
        ("tables", tables_dtype(SAMPLES, CHANNEL_COUNT)),
        ("channels", "i8"),
        ("weight", "f8", (CHANNEL_COUNT, FEATURES)),
        ("offset", "f8"),
        ("bound", "f8", (len(KNOWN),)),
        ("integral_mean", "f8", (2, SAMPLES)),
        ("integral_deviation", "f8", (2, SAMPLES)),
    ],
    align=True,
)
"""A detector as the tick reads it; all zero where there is none. weight: dh/dv of every feature v; offset: h of v = 0."""

INSERTION = np.dtype(
    [
        ("samples", "i8"),
        ("flags", "i8"),
        ("force", "f8", (CHANNEL_COUNT, SAMPLES)),
        ("fit", sums_dtype(CHANNEL_COUNT)),
        ("integral", "f8", (2,)),
        ("integral_bound", "f8", (2,)),
        ("decision", "f8"),
        ("decision_bound", "f8"),
        ("predicted_force_n", "f8"),
    ],
    align=True,
)
"""What is known of the insertion under way: forces by channel and sample, the fit, and what follows from them."""


def pack(detector: Detector) -> np.ndarray:
    """The detector as :data:`DETECTOR`, shape (1,)."""
    packed: np.ndarray = np.zeros(1, DETECTOR)
    p, folding = packed[0], detector.folding
    p["on"], p["depth_mm"], p["step"] = 1, GRID * FULL_DEPTH_MM, GRID[1]
    p["tables"] = tabulate(detector.forces, GRID)[0]
    slope = folding.weight / folding.standard.deviation
    p["channels"] = folding.channels
    p["weight"][: folding.channels] = slope.reshape(folding.channels, FEATURES)
    p["offset"] = folding.bias - slope @ folding.standard.mean
    p["bound"] = folding.bound
    p["integral_mean"], p["integral_deviation"] = detector.buckling.mean, detector.buckling.deviation
    return packed
