"""Which ticks are over budget, and which part of one was the longest."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rtctl.stages import LATE_SHARE, RECORD, STAGES, TICK_SHARE

WAKE_UP = "wake-up"
BETWEEN = "between"
"""The part of a tick that no stage covers: after its record is gone, before the loop waits for the next."""


@dataclass(frozen=True)
class Hold:
    """The part of a tick that took longest.

    Attributes:
        part: name of a stage, WAKE_UP or BETWEEN.
        tick: in which it was.
        held_ns: how long it took.
    """

    part: str
    tick: int
    held_ns: int


def bounds_ns(period_ns: int) -> tuple[int, int]:
    """(longest tick, latest wake-up) within budget [ns]."""
    return round(TICK_SHARE * period_ns), round(LATE_SHARE * period_ns)


def over_budget(rows: np.ndarray, period_ns: int) -> np.ndarray:
    """Which records (n,) tell of a tick over budget: too long, too late, or after grid points missed for no such reason.

    A commit that was too long is told by the record after it. What the first tick of a run missed is the time before
    the loop began.
    """
    longest_ns, latest_ns = bounds_ns(period_ns)
    long = (rows["tick_ns"] > longest_ns) | (rows["stage_ns"][:, RECORD] > longest_ns)
    over = long | (rows["lateness_ns"] > latest_ns)
    missed = (rows["missed_ticks"] > 0) & (rows["missed_ticks"] < rows["tick"])
    missed[1:] &= ~over[:-1]
    return over | missed


def longest_part(before: Any, row: Any, period_ns: int) -> Hold:
    """What took longest of what `row` tells; `before` is the record before it, None if it is not known."""
    tick = int(row["tick"])
    ran_before = tick - 1 - int(row["missed_ticks"]) if before is None else int(before["tick"])
    parts = [Hold(WAKE_UP, tick, int(row["lateness_ns"]))]
    for number, stage in enumerate(STAGES):
        parts.append(Hold(stage.name, ran_before if number == RECORD else tick, int(row["stage_ns"][number])))
    if before is not None and row["missed_ticks"]:
        used = int(before["lateness_ns"]) + int(before["tick_ns"]) + int(row["stage_ns"][RECORD])
        parts.append(Hold(BETWEEN, ran_before, int(row["missed_ticks"]) * period_ns - used))
    return max(parts, key=lambda part: part.held_ns)
