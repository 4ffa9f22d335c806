"""The words on a tick over budget: what happened, and who held the loop."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rtctl.attribution.budget import BETWEEN, WAKE_UP, bounds_ns, longest_part
from rtctl.attribution.causes import CAUSES, Case
from rtctl.attribution.evidence import Evidence
from rtctl.stages import STAGES

PARTS = {stage.name: stage.what for stage in STAGES}
VIRTUAL = "this is a virtual machine: suspect its host"
BARE = "on bare metal suspect SMI (hwlatdetect) or interrupts"


@dataclass(frozen=True)
class Verdict:
    """Who held the loop, as far as can be seen.

    Attributes:
        what: which tick was over budget, and by how much.
        causes: names of the causes found, the strongest first; empty if nothing explains it.
        text: all of it in one sentence.
        remedy: what to do about the strongest.
        held_ns: length of the longest part of that tick.
    """

    what: str
    causes: tuple[str, ...]
    text: str
    remedy: str
    held_ns: int


def explain(rows: np.ndarray, at: int, evidence: Evidence, period_ns: int) -> Verdict:
    """Judge record `at` of `rows` (n,), which is over budget; the neighbours tell what came before and of it.

    Args:
        rows: consecutive controller records, with the signals of TIMING in :mod:`rtctl.record`.
    """
    row, before = rows[at], rows[at - 1] if at else None
    hold = longest_part(before, row, period_ns)
    case = Case(hold, row, before, int(np.median(rows["voluntary_switches"])), evidence)
    after = int(rows[at + 1]["missed_ticks"]) if at + 1 < len(rows) else 0
    what = _what(case, after, period_ns)
    told = [(cause, words) for cause in CAUSES if (words := cause.found(case))]
    found, hints = [t for t in told if not t[0].hint], [t for t in told if t[0].hint]
    sentence = [words for _, words in found[:2]]
    if not found:
        sentence = ["nothing visible from here explains it; " + (VIRTUAL if evidence.virtual else BARE)]
        sentence += _unseen(evidence)
    sentence += [words for _, words in hints]
    remedy = (found or hints)[0][0].remedy if told else "look for the cause with `rtctl doctor`"
    return Verdict(
        what, tuple(cause.name for cause, _ in found), f"{what}: {'; '.join(sentence)}", remedy, hold.held_ns
    )


def _what(case: Case, after: int, period_ns: int) -> str:
    """Which tick, how long or how late, and in which part of it."""
    hold, row = case.hold, case.row
    longest_ns, latest_ns = bounds_ns(period_ns)
    missed = after or int(row["missed_ticks"])
    tail = f", {missed} grid point{'' if missed == 1 else 's'} missed" if missed else ""
    if hold.part == WAKE_UP:
        return f"tick {hold.tick} woke {_ms(hold.held_ns)} late (at most {_ms(latest_ns)}){tail}"
    if hold.part == BETWEEN:
        return f"after tick {hold.tick} the loop was held for {_ms(hold.held_ns)} or more{tail}"
    took = int(row["tick_ns"]) if hold.tick == row["tick"] else hold.held_ns
    return f"tick {hold.tick} took {_ms(took)} (at most {_ms(longest_ns)}), {_ms(hold.held_ns)} in {hold.part} ({PARTS[hold.part]}){tail}"


def _unseen(evidence: Evidence) -> list[str]:
    """What would help and cannot be read here."""
    counted = evidence.counted
    if counted is None:
        return ["the system's counters were not read in time"]
    missing = [("run-queue wait", counted.run_wait_ms), ("steal", counted.steal_ms), ("interrupts", counted.interrupts)]
    names = [name for name, value in missing if value is None]
    return [f"not to be read on this kernel: {', '.join(names)}"] if names else []


def _ms(ns: Any) -> str:
    return f"{ns * 1e-6:.2f} ms" if ns < 10_000_000 else f"{ns * 1e-6:.1f} ms"
