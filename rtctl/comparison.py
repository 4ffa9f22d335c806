"""Two runs beside each other: how far their signals are apart, tick by tick or at equal depth, and what was set differently."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np

from hal.errors import RtctlError
from rtctl.hil import comparison as insertions
from rtctl.lifecycle import Motion
from rtctl.log.reader import Log
from rtctl.record import TIMING, controller_table
from rtctl.replaying.stages import along_the_tick

HEADER = ("kernel_hash", "revision", "seed", "grade", "backend", "robot", "python", "machine")
"""Texts of the header that may explain a difference; packages come after them."""


@dataclass(frozen=True)
class Line:
    """How far one signal of two runs is apart: root of the mean square, largest, and where that is.

    `where` is a tick or a depth [mm]. `bound` is what the rms may be, where that is known. `unknown` counts ticks in which only
    one run knows the value; they are in neither figure.
    """

    signal: str
    unit: str
    rms: float
    largest: float
    where: float
    bound: float | None = None
    unknown: int = 0

    @property
    def good(self) -> bool:
        """Within the bound; without one, equal."""
        return bool(self.rms <= (self.bound or 0.0)) and not self.unknown


def has_insertion(rows: np.ndarray) -> bool:
    """Whether controller records (n,) hold an insertion that can be compared by depth."""
    return int(np.count_nonzero(rows["motion"] == Motion.INSERT)) > 1


def by_depth(one: np.ndarray, other: np.ndarray) -> list[Line]:
    """Two insertions at equal depth, records (n,) and (m,), within the bounds of :mod:`rtctl.hil.comparison`.

    Raises:
        RtctlError: one has no insertion, or they have no depths in common.
    """
    return [
        Line(d.signal.name, d.signal.unit, d.rms, d.largest, d.depth_mm, d.signal.bound)
        for d in insertions.compare(one, other)
    ]


def by_tick(one: np.ndarray, other: np.ndarray) -> list[Line]:
    """Every signal of two runs in the ticks both have, records (n,) and (m,), in the order of the tick.

    Raises:
        RtctlError: they have no tick in common.
    """
    ticks, i, j = np.intersect1d(one["tick"], other["tick"], return_indices=True)
    if not len(ticks):
        raise RtctlError("the runs have no tick in common", remedy="compare insertions by depth: --by depth")
    units = {s.name: s.unit for s in controller_table(one["pose_measured"].shape[1]).signals}
    common = [n for n in one.dtype.names or () if n in units and n in (other.dtype.names or ())]
    lines = []
    for name in along_the_tick(n for n in common if one.dtype[n] == other.dtype[n]):
        if name not in TIMING and name not in ("tick", "time_ns"):
            lines += list(_lines(name, units[name], ticks, one[name][i], other[name][j]))
    return lines


def _lines(name: str, unit: str, ticks: np.ndarray, one: np.ndarray, other: np.ndarray) -> Iterator[Line]:
    """A line for every component of a signal."""
    a, b = (values.reshape(len(ticks), -1) for values in (one, other))
    for c in range(a.shape[1]):
        x, y = a[:, c].astype(float), b[:, c].astype(float)
        known = ~np.isnan(x) & ~np.isnan(y)
        unknown = int(np.count_nonzero(np.isnan(x) != np.isnan(y)))
        gap = np.where(known, np.abs(x - y), 0.0)
        rms = float(np.sqrt(np.sum(gap**2) / max(np.count_nonzero(known), 1)))
        label = name if a.shape[1] == 1 else f"{name}[{c}]"
        yield Line(label, unit, rms, float(gap.max()), float(ticks[np.argmax(gap)]), None, unknown)


def set_differently(one: Log, other: Log) -> dict[str, tuple[Any, Any]]:
    """Name -> values of both, of everything in the headers and parameter sets that differs; None is absent."""
    packages = sorted({k for log in (one, other) for k in log.header if k.startswith("package.")})
    found = [dict(_header(log, (*HEADER, *packages))) for log in (one, other)]
    for log, facts in zip((one, other), found, strict=True):
        facts |= {f"settings {k}": v for k, v in _flat(log.settings_table())}
        for entry in log.parameters:
            facts |= {f"parameters {entry['number']} {k}": v for k, v in _flat(entry.get("changed", {}))}
        plans = [entry["record_base64"] for entry in log.plans if "record_base64" in entry]
        facts["plans"] = f"{len(plans)}, bytes {crc32(''.join(plans).encode()):08x}"
    names = list({**found[0], **found[1]})
    return {n: (found[0].get(n), found[1].get(n)) for n in names if found[0].get(n) != found[1].get(n)}


def _header(log: Log, names: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    return ((name, log.header[name]) for name in names if name in log.header)


def _flat(table: dict[str, Any], where: str = "") -> Iterator[tuple[str, Any]]:
    """(dotted name, value) of every leaf."""
    for name, value in table.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{where}{name}.")
        else:
            yield f"{where}{name}", value
