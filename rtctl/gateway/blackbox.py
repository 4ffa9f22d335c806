"""Black boxes: around a tick over budget, or a fault, the ticks before and after it, and who held the loop.

The ring still holds the ticks before, so in a run that goes well this costs a look at four numbers of every record.
"""

import time
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from rtctl.attribution.budget import longest_part, over_budget
from rtctl.attribution.evidence import Counters, Evidence, Sighting
from rtctl.attribution.verdict import Verdict, explain
from rtctl.exchange.ring import RingReader, committed
from rtctl.gateway.events import Event
from rtctl.gateway.witness import Witness
from rtctl.record import TIMING

TICKS = 50
"""Before the tick in question, and after it."""
COUNT_S = 0.1
"""Between two readings of the system's counters."""
STILL_S, STILL_TICKS = 0.003, 3
"""Silence of the loop after which the gateway looks at its thread: the longer of the two,"""
LOOKS = 3
"""and so often at most."""
BURST, EVERY_S = 5, 5.0
"""So many black boxes in a row, then one in that time, of each order of magnitude: small holds do not hide long ones."""
KEPT = 8
"""Newest boxes that clients can ask for."""
COLUMNS = ("tick", "missed_ticks", *sorted(TIMING))
SIGNALS = (
    "tick", "operating_state", "task_state", "motion", "powered", "condition_active", "trouble", "command_verb",
    "pose_measured", "pose_reference", "stylet_measured_mm", "stylet_reference_mm", "depth_mm", "axis_angle_rad",
    "axis_reference_rad", "command_applied_v", "force_axial_n", "force_lateral_n", "impedance_ohm",
)  # fmt: skip
"""Of the last ticks before a fault: what moved, where to, and what was felt."""


@dataclass(frozen=True)
class Pending:
    """A box that waits for the ticks after it."""

    fault: bool
    tick: int
    time_ns: int
    at: int
    """number of its record in the ring"""
    evidence: Evidence
    backlog: int
    left_out: int
    cause: str = ""
    """words on the fault"""


class BlackBoxes:
    """Opens them, freezes them, and keeps the newest.

    Args:
        ring, dtype: of the controller's records.
        witness: looks at the machine.
        period_ns: of the loop.
        clock: seconds, monotonic.
    """

    def __init__(
        self,
        ring: np.ndarray,
        dtype: np.dtype,
        witness: Witness,
        period_ns: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._ring, self._dtype, self._witness, self._period_ns, self._clock = ring, dtype, witness, period_ns, clock
        self.left_out = 0
        """ticks over budget that are in no box: too many, or before anybody looked"""
        self._allowed: defaultdict[str, _Allowance] = defaultdict(lambda: _Allowance(clock()))
        self._first_tick: int | None = None
        self._pending: list[Pending] = []
        self._boxed_until = -1
        self._position = self._looks = 0
        self._core = -1
        self._counters: deque[Counters] = deque(maxlen=4)
        self._sightings: deque[Sighting] = deque(maxlen=4 * LOOKS)
        self._rows_s = np.inf
        self._count_s = 0.0
        self._kept: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._of_fault: Pending | dict[str, Any] | None = None

    def watch(self, rows: np.ndarray, position: int) -> list[dict[str, Any]]:
        """Take note of the next controller records (n,), which end before number `position` of the ring.

        Call it often, also without rows. Returns the boxes that are complete now; see :meth:`box`.
        """
        now_s = self._clock()
        if self._first_tick is None:
            self._first_tick = self._witness.tick()
        if len(rows):
            if rows[-1]["core"] != self._core:
                self._core = int(rows[-1]["core"])
                self._witness.keep_off(self._core)
            self._position = position
            self._rows_s, self._looks = now_s, 0
            self._open(rows, now_s)
        elif now_s - self._rows_s > max(STILL_S, STILL_TICKS * self._period_ns * 1e-9) * (1 + self._looks) and self._looks < LOOKS:  # fmt: skip
            self._looks += 1
            seen = self._witness.look()
            if seen is not None:
                self._sightings.append(seen)
        if now_s >= self._count_s and self._looks == 0:
            self._count_s = now_s + COUNT_S
            self._counters.append(self._witness.count(self._core))
        return self.freeze(all_of_them=False)

    def freeze(self, all_of_them: bool = True) -> list[dict[str, Any]]:
        """Boxes whose ticks are complete, or all, with the ticks there are."""
        ripe = [p for p in self._pending if all_of_them or self._position > p.at + TICKS]
        if not ripe:
            return []
        self._pending = [p for p in self._pending if p not in ripe]
        frozen = []
        for pending in ripe:
            box = self._freeze(pending)
            if box is None:
                continue
            frozen.append(box)
            self._kept.append(box)
            if pending is self._of_fault:
                self._of_fault = box
        return frozen

    def of_fault(self, event: Event) -> Event:
        """The event of a fault with the last ticks before it, and a box under way; any other event as it is.

        The records with its tick must have been watched before.
        """
        if event.kind != "state" or event.severity != "error" or not self._allowed["fault"].take(self._clock()):
            return event
        rows = self._window(self._position - 2 * TICKS, 2 * TICKS)
        found = np.flatnonzero(rows["tick"] == event.tick)
        if not len(found):
            return event
        at = self._position - len(rows) + int(found[0])
        pending = self._begin(rows[found[0]], at, fault=True, cause=event.text)
        self._of_fault = pending
        last = rows[max(0, found[0] + 1 - TICKS) : found[0] + 1]
        return msgspec.structs.replace(event, blackbox=event.tick, last=_table(last, SIGNALS))

    def box(self, tick: int | None = None) -> dict[str, Any] | None:
        """The box of a tick; without one, that of the newest fault, which may still wait for the ticks after it.

        None if there is none, or it is too old. From any thread.
        """
        if tick is None:
            box = self._of_fault
            return self._freeze(box) if isinstance(box, Pending) else box
        return next((b for b in list(self._kept) if b["tick"] == tick), None)

    def _open(self, rows: np.ndarray, now_s: float) -> None:
        """Begin a box at the first tick over budget that is in none yet."""
        for i in np.flatnonzero(over_budget(rows, self._period_ns)):
            row = rows[i]
            if row["tick"] <= self._boxed_until:
                continue
            magnitude = str(len(str(longest_part(None, row, self._period_ns).held_ns)))
            if row["tick"] > self._first_tick and self._allowed[magnitude].take(now_s):
                self._boxed_until = int(row["tick"]) + TICKS
                self._begin(row, self._position - len(rows) + int(i))
                self.left_out = 0
            else:
                self.left_out += 1

    def _begin(self, row: Any, at: int, fault: bool = False, cause: str = "") -> Pending:
        tick = int(row["tick"])
        pending = Pending(
            fault, tick, int(row["time_ns"]), at, self._evidence(row), int(committed(self._ring)) - self._position,
            0 if fault else self.left_out, cause,
        )  # fmt: skip
        self._pending.append(pending)
        return pending

    def _evidence(self, row: Any) -> Evidence:
        """What the machine says of the time since before the tick of `row`."""
        core, before = int(row["core"]), int(row["tick"]) - 1 - int(row["missed_ticks"])
        older = [c for c in self._counters if c.tick < before]
        return Evidence(
            counted=self._witness.count(core).since(older[-1]) if older else None,
            usual=older[-1].since(older[-2]) if len(older) > 1 else None,
            sightings=tuple(s for s in self._sightings if s.tick >= before - 1),
            frequency_mhz=self._witness.frequency_mhz(core),
            virtual=self._witness.virtual,
        )

    def _window(self, first: int, count: int) -> np.ndarray:
        """Records from number `first` on, as far as they are in the ring and have been watched."""
        first = max(0, first)
        count = min(count, self._position - first)
        return RingReader(self._ring, self._dtype, limit=max(1, count), position=first).read()

    def _freeze(self, pending: Pending) -> dict[str, Any] | None:
        """The box; None if its records have been overwritten."""
        rows = self._window(pending.at - TICKS, 2 * TICKS + 1)
        found = np.flatnonzero(rows["tick"] == pending.tick)
        if not len(found):
            return None
        at, over = int(found[0]), np.flatnonzero(over_budget(rows, self._period_ns))
        judged = at if not pending.fault else int(over[over <= at][-1]) if (over <= at).any() else None
        verdict = None if judged is None else explain(rows, judged, pending.evidence, self._period_ns)
        return document(pending, rows, over, verdict)


def document(pending: Pending, rows: np.ndarray, over: np.ndarray, verdict: Verdict | None) -> dict[str, Any]:
    """A box as plain values: words first, then what they rest on.

    Args:
        rows: records (n,) around the one in question; those at `over` (k,) are over budget.
        verdict: on the tick over budget, None if there is none.
    """
    text = verdict.text if verdict else "no tick was over budget before it"
    if pending.fault:
        text = f"{pending.cause}; {text}"
    elif len(over) > 1:
        text += f"; {len(over) - 1} more within {TICKS} ticks of it"
    if pending.left_out:
        text += f"; {pending.left_out} before it have no black box"
    box = {
        "tick": pending.tick,
        "time_ns": pending.time_ns,
        "reason": "fault" if pending.fault else "timing",
        "text": text,
        "remedy": verdict.remedy if verdict else "",
        "causes": list(verdict.causes) if verdict else [],
        "over_budget": rows["tick"][over].tolist(),
        "left_out": pending.left_out,
        "backlog_rows": pending.backlog,
        "evidence": msgspec.to_builtins(pending.evidence),
        "rows": _table(rows, COLUMNS),
    }
    return box | ({"signals": _table(rows, SIGNALS)} if pending.fault else {})


def event_of(box: Mapping[str, Any]) -> Event:
    """The diary's line on a tick over budget."""
    return Event(
        time_ns=box["time_ns"], tick=box["tick"], kind="timing", severity="warning", text=box["text"],
        remedy=box["remedy"], blackbox=box["tick"],
    )  # fmt: skip


class _Allowance:
    """A few at once, then one in a while."""

    def __init__(self, now_s: float) -> None:
        self._left, self._since_s = float(BURST), now_s

    def take(self, now_s: float) -> bool:
        """One more is allowed at this time."""
        self._left = min(BURST, self._left + (now_s - self._since_s) / EVERY_S)
        self._since_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


def _table(rows: np.ndarray, names: tuple[str, ...]) -> dict[str, list]:
    """Columns of `rows` (n,) by name, plain values; a number that is not known is None."""
    return {name: _plain(rows[name].tolist()) for name in names}


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(v) for v in value]
    if isinstance(value, float):
        return float(f"{value:.7g}") if np.isfinite(value) else None
    return value
