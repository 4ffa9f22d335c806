"""The scope on a log: the same triggers, as if one had been there."""

from collections.abc import Iterator

import numpy as np

from hal.backend import load
from hal.errors import RtctlError
from hal.signals import ROS_TYPES, Signal, Table
from rtctl.log.format import CONTROLLER, TRUTH
from rtctl.log.reader import Log
from rtctl.record import controller_table
from rtctl.scope.capture import Capture
from rtctl.scope.pairing import join
from rtctl.scope.probe import Rows
from rtctl.scope.scope import Scope, State
from rtctl.scope.setup import Setup
from rtctl.settings import from_table

PIECE = 4096
"""Rows at a time."""


def captures_of(log: Log, setup: Setup) -> Iterator[Capture]:
    """Every capture `setup` finds in the log, in order; one that its end cut off is not complete.

    Raises:
        ScopeError: the log has no such signals.
        LogError: it has no records.
    """
    scope = Scope(setup, tables_of(log))
    rows = Rows(log.controller)
    if scope.needs_truth:
        assert log.truth is not None  # or the scope had found no such signal
        rows = join(log.controller, log.truth)
    for start in range(0, len(rows.records), PIECE):
        piece = slice(start, start + PIECE)
        scope.feed(Rows(rows.records[piece], None if rows.truths is None else rows.truths[piece]))
        while scope.finished:
            yield scope.take()
        if scope.state is State.DONE:
            return
    scope.interrupt()
    yield from scope.finished


def tables_of(log: Log) -> dict[str, Table]:
    """Topic -> table of the rows in a log. It tells their types; units are those of today's signals of that name."""
    dof = int(log.controller["pose_measured"].shape[1])
    known = {CONTROLLER: controller_table(dof), TRUTH: _truth(log)}
    return {topic: _table(topic, log.rows[topic].dtype, table) for topic, table in known.items() if topic in log.rows}


def _truth(log: Log) -> Table | None:
    try:
        settings = from_table(log.settings_table())
        backend = load(settings.backend.name, settings.backend.options, period_s=settings.loop.period_s, seed=0)
    except RtctlError:  # of another version, or a backend that is not installed here
        return None
    truth = backend.truth()
    return None if truth is None else truth[0]


def _table(topic: str, dtype: np.dtype, today: Table | None) -> Table:
    known = {} if today is None else {s.name: s for s in today.signals}
    signals = []
    for name in dtype.names or ():
        if name != "reserved":
            s = known.get(name, Signal(name, "", (), "", ""))
            code = dtype[name].base.str[1:]
            assert code in ROS_TYPES
            signals.append(Signal(name, code, dtype[name].shape, s.unit, s.meaning, s.frame))
    return Table(topic.strip("/").title(), tuple(signals))
