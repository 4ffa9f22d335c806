"""From the names of signals to their columns in the rows of the record and of the truth."""

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hal.signals import TICK, TIME, Signal, Table
from rtctl.log.format import CONTROLLER, TRUTH
from rtctl.scope.setup import ScopeError

PREFIX = "truth."
"""In front of the names of signals that only a simulation knows."""
NAME = re.compile(r"([a-z0-9_.]+)(?:\[(\d{1,4})\])?")
ALWAYS = (
    TIME,
    TICK,
    Signal("missed", "i4", (), "ticks", "grid points the loop skipped since the sample before"),
    Signal("lost", "i4", (), "ticks", "ticks since the sample before that ran but whose records were lost"),
)
"""In every capture, before the signals asked for. Gaps are told at the first sample after them."""


class Rows(NamedTuple):
    """Consecutive rows of the controller (n,), and the truths (n,) of the same ticks where they are asked for."""

    records: np.ndarray
    truths: np.ndarray | None = None


@dataclass(frozen=True)
class Column:
    """Where a signal is found, and what it is: `signal` has the name that was asked for."""

    signal: Signal
    topic: str
    field: str
    index: int | None

    def of(self, rows: Rows) -> np.ndarray:
        """Its values, shape (n,) or (n, k)."""
        source = rows.truths if self.topic == TRUTH else rows.records
        assert source is not None
        values = source[self.field]
        return values if self.index is None else values[:, self.index]


def find(name: str, tables: Mapping[str, Table]) -> Column:
    """The column called `name`: a signal, one number of a vector (``wrench_in_base[2]``), or a ``truth.`` of those.

    Raises:
        ScopeError: there is no such signal, or not so many numbers in it.
    """
    match = NAME.fullmatch(name)
    base, index = (match[1], match[2]) if match else (name, None)
    topic = TRUTH if base.startswith(PREFIX) else CONTROLLER
    if topic not in tables:
        raise ScopeError("only a simulation knows a truth", value=name, remedy="ask for signals of the controller")
    field = base.removeprefix(PREFIX)
    signals = {s.name: s for s in tables[topic].signals}
    if field not in signals:
        near = difflib.get_close_matches(field, signals, 1)
        remedy = f"did you mean {base[: -len(field)]}{near[0]}?" if near and field else "see docs/reference/signals.md"
        raise ScopeError("there is no such signal", value=name, remedy=remedy)
    found = signals[field]
    if index is None:
        return Column(replace(found, name=name), topic, field, None)
    count = found.shape[0] if found.shape else 0
    if int(index) >= count:
        bound = f"{field}[0] .. {field}[{count - 1}]" if count else f"{field}, which is one number"
        raise ScopeError("a signal has not so many numbers", value=name, bound=bound, remedy="count from 0")
    return Column(replace(found, name=name, shape=()), topic, field, int(index))


def find_number(name: str, tables: Mapping[str, Table]) -> Column:
    """The same, of one number.

    Raises:
        ScopeError: there is none of that name, or it is a vector.
    """
    column = find(name, tables)
    if column.signal.shape:
        remedy = f"choose one, as in {name}[0]"
        raise ScopeError("a trigger looks at one number, not at a vector", value=name, remedy=remedy)
    return column


def row_dtype(signals: Iterable[Signal]) -> np.dtype:
    """The dtype of a sample: what is always there, then `signals` by the names they were asked for."""
    return np.dtype([(s.name, s.type, s.shape) if s.shape else (s.name, s.type) for s in (*ALWAYS, *signals)])


class Probe:
    """Takes the samples of a scope out of rows.

    Raises:
        ScopeError: an unknown signal, or one that is named twice.
    """

    def __init__(self, names: Sequence[str], tables: Mapping[str, Table]) -> None:
        self.columns = tuple(find(name, tables) for name in names)
        taken = {s.name for s in ALWAYS}
        for name in names:
            if name in taken:
                raise ScopeError(
                    "a signal is named twice, or in every capture anyway", value=name, remedy="leave it out"
                )
            taken.add(name)
        self.dtype = row_dtype(c.signal for c in self.columns)

    def take(self, rows: Rows, kept: np.ndarray) -> np.ndarray:
        """Samples (k,) of the rows chosen by the mask `kept` (n,); without their gaps."""
        samples = np.zeros(np.count_nonzero(kept), self.dtype)
        for name in ("time_ns", "tick"):
            samples[name] = rows.records[name][kept]
        for column in self.columns:
            samples[column.signal.name] = column.of(rows)[kept]
        return samples
