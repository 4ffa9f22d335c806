"""What the logs of a soak hold: gaps, ticks in and out of outages, and whether a replay is identical; file by file.

An hour of records does not fit into memory at once, and need not: the controller goes on from file to file.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hal.errors import RtctlError
from rtctl.controller import Controller
from rtctl.log.reader import Log
from rtctl.replay import staged_in
from rtctl.replaying.difference import Difference, first_difference
from rtctl.rerun import Staged, rerun
from rtctl.settings import from_table
from rtctl.soak.run import Outage

TIMES = ("tick_ns", "lateness_ns")


@dataclass
class Recorded:
    """The run as its logs tell it.

    Attributes:
        missing: ticks that ran and are in no log.
        told_lost: of those the gateways told in their events.
        cut_short: files without an end; `lost_bytes` is what none of their readers understands.
        during, outside: signal -> values (n,) [ns] of ticks in an outage and of all others.
        replay_error: why the replay could not go on.
        replay_ended_by_gap: records are missing, so it was not tried beyond them.
    """

    files: int = 0
    rows: int = 0
    ticks: int = 0
    missed: int = 0
    missing: int = 0
    told_lost: int = 0
    cut_short: int = 0
    last_is_whole: bool = False
    ends_safely: bool = False
    replayed: int = 0
    difference: Difference | None = None
    replay_error: str = ""
    replay_ended_by_gap: bool = False
    row_bytes: int = 0
    truth_bytes: int = 0
    during: dict[str, np.ndarray] = field(default_factory=dict)
    outside: dict[str, np.ndarray] = field(default_factory=dict)


def read(paths: list[Path], outages: list[Outage]) -> Recorded:
    """Go through the logs of a run, in order.

    Raises:
        LogError: a file is not even the beginning of a log.
    """
    found = Recorded(files=len(paths))
    replay = _Replay()
    times: dict[bool, list[np.ndarray]] = {True: [], False: []}
    last_tick = -1
    for path in paths:
        log = Log.open(path)
        found.cut_short += not log.complete
        found.last_is_whole = log.complete
        found.told_lost += sum(_lost(event.get("text", "")) for event in log.events if event.get("kind") == "records")
        if "/controller" not in log.rows:
            continue
        rows = log.controller[log.controller["tick"] > last_tick]
        if not len(rows):
            continue
        found.row_bytes = rows.dtype.itemsize
        found.truth_bytes = 0 if log.truth is None else log.truth.dtype.itemsize
        gaps = np.diff(rows["tick"], prepend=last_tick) - 1 - rows["missed_ticks"]
        found.missing += int(gaps.sum())
        found.missed += int(rows["missed_ticks"].sum())
        found.rows += len(rows)
        last_tick = int(rows["tick"][-1])
        inside = np.zeros(len(rows), bool)
        for outage in outages:
            inside |= (rows["time_ns"] >= outage.killed_ns) & (rows["time_ns"] <= outage.back_ns)
        both = np.column_stack([rows[name] for name in TIMES])
        times[True].append(both[inside])
        times[False].append(both[~inside])
        found.ends_safely = not rows[-1]["power_request"] and not rows[-1]["command_applied_v"].any()
        replay.go_on(log, rows, whole=not gaps.any())
    found.ticks = last_tick + 1 - found.missed
    found.replayed, found.difference, found.replay_error = replay.ticks, replay.difference, replay.error
    found.replay_ended_by_gap = replay.ended_by_gap
    for where, blocks in ((found.during, times[True]), (found.outside, times[False])):
        joined = np.concatenate([np.zeros((0, 2), "i4"), *blocks])
        where.update({name: joined[:, k] for k, name in enumerate(TIMES)})
    return found


class _Replay:
    """A replay that goes on from file to file until something is missing or differs."""

    def __init__(self) -> None:
        self._controller: Controller | None = None
        self._staged: Staged = {"staged_plan": {}, "staged_parameters": {}}
        self.ticks, self.error, self.ended_by_gap = 0, "", False
        self.difference: Difference | None = None

    def go_on(self, log: Log, rows: np.ndarray, whole: bool) -> None:
        """The next rows (n,) of the run; `whole`: none are missing before or among them."""
        self.ended_by_gap |= not whole
        if self.ended_by_gap or self.error or self.difference is not None:
            return
        try:
            self._controller = self._controller or Controller(from_table(log.settings_table()))
            for name, payloads in staged_in(log, self._controller).items():
                self._staged[name] |= payloads
            self.difference = first_difference(rows, rerun(self._controller, rows, self._staged))
        except RtctlError as error:
            self.error = str(error)
            return
        self.ticks += len(rows)


def _lost(text: str) -> int:
    """The number in "17 rows of /controller were overwritten before they were logged"; 0 for another text."""
    words = text.split()
    return int(words[0]) if words[1:4] == ["rows", "of", "/controller"] and words[0].isdigit() else 0
