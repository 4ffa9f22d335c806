"""Ticks that ended after the next grid point, and which part of them took the time."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

KEPT = 50
"""Of the longest overruns; all are counted."""
WAKE_UP, TICK, BETWEEN = "wake-up", "tick", "between ticks"


@dataclass(frozen=True)
class Overrun:
    """Grid points that were missed.

    Attributes:
        round: of the certificate, from 1.
        tick: the last one that ran before.
        missed_ticks: grid points skipped after it.
        held_by: its longest part: it woke up late, it took long, or the time went after its record was out.
        lateness_us, tick_us: of that tick.
    """

    round: int
    tick: int
    missed_ticks: int
    held_by: str
    lateness_us: float
    tick_us: float


class Overruns:
    """Finds them in the records of one run of the loop, block by block.

    What the first record of a run missed is the time before the loop began.
    """

    def __init__(self, period_ns: int, number: int = 0) -> None:
        """number: of the round."""
        self._period_ns, self._round = period_ns, number
        self._before: Any = None
        self.missed_ticks = 0
        self.held_by = dict.fromkeys((WAKE_UP, TICK, BETWEEN), 0)
        self._found: list[Overrun] = []

    def see(self, rows: np.ndarray) -> None:
        """Look at the next records (n,)."""
        for i in np.flatnonzero(rows["missed_ticks"] > 0):
            before = rows[i - 1] if i > 0 else self._before
            if before is not None:
                self._note(before, int(rows[i]["missed_ticks"]))
        self._before = rows[-1].copy()

    def _note(self, before: Any, missed: int) -> None:
        lateness, tick = int(before["lateness_ns"]), int(before["tick_ns"])
        parts = {WAKE_UP: lateness, TICK: tick, BETWEEN: missed * self._period_ns - lateness - tick}
        held_by = max(parts, key=lambda part: parts[part])
        self.missed_ticks += missed
        self.held_by[held_by] += 1
        overrun = Overrun(
            self._round, int(before["tick"]), missed, held_by, round(lateness * 1e-3, 3), round(tick * 1e-3, 3)
        )
        self._keep([overrun])

    def _keep(self, found: list[Overrun]) -> None:
        self._found = sorted(self._found + found, key=lambda o: -o.missed_ticks)[:KEPT]

    def merge(self, other: "Overruns") -> None:
        """Take in what was found in another run."""
        self.missed_ticks += other.missed_ticks
        for part, count in other.held_by.items():
            self.held_by[part] += count
        self._keep(other._found)

    @property
    def count(self) -> int:
        """How often grid points were missed."""
        return sum(self.held_by.values())

    def as_table(self) -> dict[str, Any]:
        """Plain data; the longest first."""
        return {
            "overruns": self.count,
            "missed_ticks": self.missed_ticks,
            "held_by": self.held_by,
            "longest": [asdict(o) for o in self._found],
        }
