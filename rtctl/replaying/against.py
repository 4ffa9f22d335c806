"""Two revisions on the same inputs: the first tick and signal in which they differ, how the difference grows, and since when."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rtctl.controller import Controller
from rtctl.log.reader import Log
from rtctl.replay import staged_in, whole_rows
from rtctl.replaying.difference import compared, differing, first_difference
from rtctl.replaying.revisions import Outputs, RevisionError, Revisions
from rtctl.replaying.stages import stage_of
from rtctl.rerun import rerun
from rtctl.settings import from_table

LATER_TICKS = (0, 1, 10, 100, 1000, 10_000)
"""After the first difference, where its growth is told."""


@dataclass(frozen=True)
class Growth:
    """How far one signal of two revisions is apart: `largest` within so many ticks, None past the end of the log.

    Not a number against a number counts as infinite.
    """

    signal: str
    stage: str
    first_tick: int
    largest: dict[int, float | None]


@dataclass(frozen=True)
class Comparison:
    """Two revisions on one log. `tick` is None if all signals both have are identical to the bit."""

    ticks: int
    tick: int | None
    signal: str | None
    values: tuple[Any, Any] | None
    growth: tuple[Growth, ...]
    not_compared: tuple[str, ...]
    row: int | None


def here(log: Log, ticks: int | None = None) -> np.ndarray:
    """What the code at hand makes of the inputs, in its own layout (n,)."""
    controller = Controller(from_table(log.settings_table()))
    return rerun(controller, whole_rows(log)[:ticks], staged_in(log, controller))


def compare(one: np.ndarray, other: np.ndarray) -> Comparison:
    """Compare records of the same ticks, both (n,), of layouts that may differ."""
    first = first_difference(one, other)
    left_out = tuple(compared(one.dtype, other.dtype)[1])
    if first is None:
        return Comparison(len(one), None, None, None, (), left_out, None)
    row = int(np.searchsorted(one["tick"], first.tick))
    growth = tuple(_growth(name, rows, one, other, row) for name, rows in differing(one, other).items())
    by_tick = tuple(sorted(growth, key=lambda g: g.first_tick))  # stable: within a tick the order of the tick
    return Comparison(len(one), first.tick, first.field, (first.logged, first.replayed), by_tick, left_out, row)


def _growth(name: str, rows: np.ndarray, one: np.ndarray, other: np.ndarray, row: int) -> Growth:
    a, b = (r[name].reshape(len(r), -1).astype(float) for r in (one, other))
    with np.errstate(invalid="ignore"):
        gap = np.where(np.isnan(a) & np.isnan(b), 0.0, np.nan_to_num(np.abs(a - b), nan=np.inf)).max(axis=1)
    largest = {n: float(gap[row : row + n + 1].max()) if row + n < len(gap) else None for n in LATER_TICKS}
    return Growth(name, stage_of(name), int(one["tick"][rows[0]]), largest)


@dataclass(frozen=True)
class Culprit:
    """The first commit whose outputs differ, None if it is no commit: `judged` were run to find it."""

    commit: str | None
    comparison: Comparison
    candidates: int
    judged: int


def bisect(
    revisions: Revisions, log: Log, good: str, bad: str, report: Callable[[str], None] = lambda _: None
) -> Culprit:
    """The first commit after `good`, up to `bad`, whose outputs differ from those of `good`, along first parents.

    Only commits that touch a kernel source are candidates, and only ticks up to the first difference are run.

    Raises:
        RevisionError: `good` is not in the history of `bad`, or a commit cannot replay the log.
    """
    if not revisions.is_ancestor(good, bad):
        raise RevisionError("there is no way from the one revision to the other", value=f"{good[:12]}..{bad[:12]}", remedy="give an ancestor first")  # fmt: skip
    report(f"running {revisions.subject(good)}")
    before = revisions.outputs(good, log)
    report(f"running {revisions.subject(bad)}")
    after = revisions.outputs(bad, log)
    comparison = compare(before.rows, after.rows)
    if comparison.row is None:
        return Culprit(None, comparison, 0, 2)
    files = sorted({*before.kernel_sources, *after.kernel_sources})
    candidates = revisions.touching(good, bad, files)
    ticks, low, high, judged = comparison.row + 1, 0, len(candidates) - 1, 2
    while low < high:  # the culprit is in candidates[low : high + 1]
        middle = (low + high) // 2
        report(f"{high - low + 1} commits left; running {revisions.subject(candidates[middle])}")
        judged += 1
        if _differs(before, revisions.outputs(candidates[middle], log, ticks), ticks):
            high = middle
        else:
            low = middle + 1
    return Culprit(candidates[low] if candidates else None, comparison, len(candidates), judged)


def _differs(before: Outputs, other: Outputs, ticks: int) -> bool:
    return first_difference(before.rows[:ticks], other.rows) is not None
