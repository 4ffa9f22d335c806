"""The same insertion through the drivers and on the plant itself, signal by signal.

Both know the same plant and seed; between them lie protocols, converters, a clock of the bench's own, and noise. What
differs by more than these explain is a fault of a driver: a sign, a scale, an axis, a tick. So the records are compared where
they must agree: over the insertion, at equal depth.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hal.errors import RtctlError
from rtctl.lifecycle import Motion

STEP_MM = 0.05
SKIPPED_MM = 0.25
"""At both ends, where the two start and brake at other ticks."""


@dataclass(frozen=True)
class Signal:
    """One line of the comparison: how to read it off records, and by how much the two may differ (root of mean square)."""

    name: str
    unit: str
    read: Callable[[np.ndarray], np.ndarray]
    bound: float
    why: str


def _coordinate(name: str, i: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda rows: rows[name][:, i]


SIGNALS = (
    Signal("pose_measured x", "mm", _coordinate("pose_measured", 0), 0.01, "the bench's tick is another: 1 µm a tick"),
    Signal("pose_measured y", "mm", _coordinate("pose_measured", 1), 0.05, "the correction follows noisy forces"),
    Signal("pose_measured phi", "rad", _coordinate("pose_measured", 2), 0.0005, "as x, over 88 mm"),
    Signal("stylet_measured", "mm", lambda r: r["stylet_measured_mm"], 0.005, "planned over depth"),
    Signal("force_axial", "N", lambda r: r["force_axial_n"], 0.005, "stick and slip at other depths, and noise"),
    Signal("force_lateral", "N", lambda r: r["force_lateral_n"], 0.005, "the same"),
    Signal("admittance_offset y", "mm", _coordinate("admittance_offset_mm", 1), 0.05, "an integral of the force"),
    Signal("command 1", "V", _coordinate("command_applied_v", 0), 0.1, "PID on quantised angles, jitter of a tick"),
    Signal("command 2", "V", _coordinate("command_applied_v", 1), 0.1, "the same"),
    Signal("command 3", "V", _coordinate("command_applied_v", 2), 0.1, "the same"),
    Signal("command stylet", "V", _coordinate("command_applied_v", 3), 0.1, "the same"),
)  # fmt: skip
"""Bounds are some five times what runs on an idle and on a busy machine differed by."""


@dataclass(frozen=True)
class Difference:
    """How one signal differs: root of the mean square and largest, over the depths both have, and where it is largest."""

    signal: Signal
    rms: float
    largest: float
    depth_mm: float

    @property
    def good(self) -> bool:
        """Within the bound; False where it is not known."""
        return bool(self.rms <= self.signal.bound)


def compare(one: np.ndarray, other: np.ndarray) -> list[Difference]:
    """Differences of two insertions from their controller records (n,) and (m,), in the order of SIGNALS.

    Raises:
        RtctlError: one of them has no insertion, or they have too few depths in common.
    """
    pair = [inserting(rows) for rows in (one, other)]
    low = max(float(rows["depth_mm"][0]) for rows in pair) + SKIPPED_MM
    high = min(float(rows["depth_mm"][-1]) for rows in pair) - SKIPPED_MM
    if high - low < 10 * STEP_MM:
        raise RtctlError("the insertions have no depths in common", value=f"{low:.2f} .. {high:.2f} mm")
    depths = np.arange(low, high, STEP_MM)
    found = []
    for signal in SIGNALS:
        a, b = (np.interp(depths, rows["depth_mm"], _smooth(signal.read(rows))) for rows in pair)
        gap = np.abs(a - b)
        where = float(depths[np.argmax(gap)])
        found.append(Difference(signal, float(np.sqrt(np.mean(gap**2))), float(np.max(gap)), where))
    return found


def _smooth(values: np.ndarray) -> np.ndarray:
    """Mean over some 50 ticks: what a tick's noise does is no difference."""
    kernel = np.ones(51) / 51
    padded = np.pad(values.astype(float), 25, mode="edge")
    return np.convolve(padded, kernel, mode="valid")


def inserting(rows: np.ndarray) -> np.ndarray:
    """The rows of the insertion, of rising depth."""
    inside = rows[rows["motion"] == Motion.INSERT]
    if len(inside) < 2:
        raise RtctlError("a run has no insertion to compare", remedy="look at its report")
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(inside["depth_mm"])) > 0])
    return inside[keep]
