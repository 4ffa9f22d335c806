"""When a scope fires: looked at in every row, whatever the decimation."""

from collections.abc import Callable, Mapping

import numpy as np

from hal.signals import Table
from rtctl.commands import Reason, Verb
from rtctl.lifecycle import Condition, Operating, Task
from rtctl.scope.probe import Column, Rows, find_number
from rtctl.scope.setup import Edge, Event, Free, Level, Manual, ScopeError, Trigger

KINDS = {"condition": Condition, "command": Verb, "state": Operating, "task": Task}
"""Kinds of events and where their names come from."""

Look = Callable[[Rows], np.ndarray]
"""Whether the trigger fires in each of the rows (n,); called with all rows in turn, because edges need the last one."""


def watch_for(trigger: Trigger, tables: Mapping[str, Table]) -> tuple[Look, tuple[Column, ...]]:
    """What watches for `trigger`, and the columns it looks at.

    Raises:
        ScopeError: it names a signal or an event that does not exist.
    """
    if isinstance(trigger, Level):
        column, level, below = find_number(trigger.signal, tables), trigger.level, trigger.side == "<"
        return lambda rows: (column.of(rows) < level) if below else (column.of(rows) > level), (column,)
    if isinstance(trigger, Edge):
        column = find_number(trigger.signal, tables)
        return _EdgeWatch(trigger, column), (column,)
    if isinstance(trigger, Event):
        return _event(trigger.event), ()
    always = {Free: True, Manual: False}[type(trigger)]
    return lambda rows: np.full(len(rows.records), always), ()


class _EdgeWatch:
    def __init__(self, edge: Edge, column: Column) -> None:
        self._edge, self._column, self._last = edge, column, np.nan

    def __call__(self, rows: Rows) -> np.ndarray:
        level, slope = self._edge.level, self._edge.slope
        now = self._column.of(rows).astype(np.float64)
        before = np.concatenate([[self._last], now[:-1]])
        self._last = now[-1]
        rising, falling = (before < level) & (now >= level), (before > level) & (now <= level)
        return {"rising": rising, "falling": falling, "either": rising | falling}[slope]


class _Beginning:
    """Fires where something holds that did not hold in the row before; what holds from the first row on, never began."""

    def __init__(self, holds: Look) -> None:
        self._holds, self._last = holds, True

    def __call__(self, rows: Rows) -> np.ndarray:
        now = self._holds(rows)
        before = np.concatenate([[self._last], now[:-1]])
        self._last = bool(now[-1])
        return now & ~before


def _event(text: str) -> Look:
    kind, _, name = text.partition(":")
    if kind not in KINDS:
        remedy = "write KIND:NAME, as in condition:force_limit"
        raise ScopeError("there is no such kind of event", value=text, bound=" | ".join(KINDS), remedy=remedy)
    names = {member.name.lower(): member for member in KINDS[kind] if member.name != "NONE"}
    if name not in names:
        raise ScopeError(f"there is no such {kind}", value=text, bound=" | ".join(names), remedy="choose one of these")
    number = int(names[name])
    if kind == "condition":
        return _Beginning(lambda rows: (rows.records["condition_active"] >> number) & 1 != 0)
    if kind == "command":  # a command is there for one tick: it begins whenever it comes
        return lambda rows: (
            (rows.records["command_verb"] == number) & (rows.records["command_verdict"] == Reason.ACCEPTED)
        )
    field = {"state": "operating_state", "task": "task_state"}[kind]
    return _Beginning(lambda rows: rows.records[field] == number)
