"""The state machine of a scope: a pure function of the rows it is fed, however they are cut into pieces.

filling     the samples before the trigger are collected; triggers are not looked at
waiting     for the trigger, while the oldest sample makes room for the newest
triggered   the samples after the trigger are collected
resting     finished captures fill the memory until somebody takes them
done        all captures are finished
"""

import enum
from collections import deque
from collections.abc import Mapping

import numpy as np

from hal.signals import Table
from rtctl.log.format import TRUTH
from rtctl.scope.capture import Capture
from rtctl.scope.probe import Probe, Rows
from rtctl.scope.setup import ScopeError, Setup
from rtctl.scope.trigger import watch_for


class State(enum.StrEnum):
    """Where a scope stands."""

    FILLING = "filling"
    WAITING = "waiting"
    TRIGGERED = "triggered"
    RESTING = "resting"
    DONE = "done"


class Scope:
    """One scope. :meth:`feed` it all rows in order; captures come out of :meth:`take`.

    Args:
        setup: what to do.
        tables: topic -> table of the rows it will be fed.
        limit_bytes: what one capture may take, and what finished captures may take together; None for no limit.

    Raises:
        ScopeError: an unknown signal or event, or a capture that is too large.
    """

    def __init__(self, setup: Setup, tables: Mapping[str, Table], limit_bytes: int | None = None) -> None:
        self.setup, self._limit_bytes = setup, limit_bytes
        self._look, looked_at = watch_for(setup.trigger, tables)
        self._probe = Probe(setup.signals, tables)
        self.signals = tuple(column.signal for column in self._probe.columns)
        self.needs_truth = any(column.topic == TRUTH for column in (*self._probe.columns, *looked_at))
        size = setup.samples * self._probe.dtype.itemsize
        if limit_bytes is not None and size > limit_bytes:
            bound = f"{limit_bytes} bytes, {limit_bytes // self._probe.dtype.itemsize} samples of these signals"
            remedy = "ask for fewer samples or signals, or raise the decimation; the log has everything anyway"
            raise ScopeError("a capture of this scope is too large", value=size, bound=bound, remedy=remedy)
        self.finished: deque[Capture] = deque()
        self.begun = 0
        """captures finished or under way"""
        self.state: State
        self._samples = np.zeros(setup.samples, self._probe.dtype)
        self._last_tick: int | None = None
        self._missed = self._lost = 0
        self._arm()

    def feed(self, rows: Rows) -> None:
        """The next rows; the truths may be left out if `needs_truth` says so."""
        n = len(rows.records)
        if not n or self.state is State.DONE:
            return
        fired, ticks = self._look(rows), rows.records["tick"]
        kept = ticks % self.setup.decimation == 0
        samples = self._probe.take(rows, kept)
        self._mark_gaps(rows.records, kept, samples)
        before = np.concatenate([[0], np.cumsum(kept)])  # how many samples lie before each row
        i = 0
        while i < n and self.state not in (State.RESTING, State.DONE):
            if self.state is State.WAITING:
                i = self._wait(i, fired, ticks, rows.records["time_ns"], before, samples)
            else:  # a number of samples is to be collected, then the state changes
                take = min(self._left, int(before[n] - before[i]))
                self._write(samples[before[i] : before[i] + take])
                self._left -= take
                i = n if self._left else int(np.searchsorted(before[i:], before[i] + take)) + i
                if not self._left:
                    self._advance()

    def force(self) -> None:
        """Fire at the next row, or as soon as the samples before the trigger are there."""
        self._forced = self.state in (State.FILLING, State.WAITING)

    def take(self) -> Capture:
        """Give away the oldest finished capture."""
        capture = self.finished.popleft()
        if self.state is State.RESTING and self._has_room():
            self._arm()
        return capture

    def interrupt(self) -> None:
        """No more rows will come: a capture under way is finished as it is, incomplete."""
        if self.state is State.TRIGGERED:
            self._finish(complete=False)
        self.state = State.DONE

    @property
    def filled(self) -> int:
        """Samples the present capture has for sure: those before the trigger, then all."""
        return self.setup.samples - self._left if self.state is State.TRIGGERED else min(self._written, self.setup.pre)

    def _arm(self) -> None:
        self.state, self._written, self._left, self._forced = State.FILLING, 0, self.setup.pre, False
        self._since: int | None = None
        if not self._left:
            self.state = State.WAITING

    def _advance(self) -> None:
        if self.state is State.FILLING:
            self.state = State.WAITING
            return
        self._finish(complete=True)
        if self.begun == self.setup.captures:
            self.state = State.DONE
        elif self._has_room():
            self._arm()
        else:
            self.state = State.RESTING

    def _has_room(self) -> bool:
        held = sum(c.rows.nbytes for c in self.finished)
        return self._limit_bytes is None or held + self._samples.nbytes <= self._limit_bytes

    def _wait(
        self, i: int, fired: np.ndarray, ticks: np.ndarray, time_ns: np.ndarray, before: np.ndarray, samples: np.ndarray
    ) -> int:
        """Look for the trigger from row `i` on; the row it fires in, or the number of rows."""
        self._since = int(ticks[i]) if self._since is None else self._since
        overdue = self.setup.auto & (ticks[i:] - self._since >= self.setup.samples * self.setup.decimation)
        hits = fired[i:] | overdue
        at = 0 if self._forced else int(hits.argmax()) if hits.any() else len(hits)
        self._write(samples[before[i] : before[i + at]])
        if at < len(hits):
            self._cause = "trigger" if fired[i + at] else "forced" if self._forced else "auto"
            self._fired_tick, self._fired_ns = int(ticks[i + at]), int(time_ns[i + at])
            self.state, self._left = State.TRIGGERED, self.setup.samples - self.setup.pre
            self.begun += 1
        return i + at

    def _write(self, samples: np.ndarray) -> None:
        """Keep the newest samples, over the oldest ones."""
        length = len(self._samples)
        newest = samples[-length:]
        places = (self._written + len(samples) - len(newest) + np.arange(len(newest))) % length
        self._samples[places] = newest
        self._written += len(samples)

    def _finish(self, complete: bool) -> None:
        """Samples of the capture, oldest first; its gaps begin with the second one."""
        count = self.setup.samples - self._left
        rows = self._samples[np.arange(self._written - count, self._written) % len(self._samples)]
        rows["missed"][:1] = rows["lost"][:1] = 0
        self.finished.append(
            Capture(
                number=self.begun - 1,
                rows=rows,
                signals=self.signals,
                trigger=str(self.setup.trigger),
                cause=self._cause,
                trigger_tick=self._fired_tick,
                trigger_time_ns=self._fired_ns,
                trigger_index=self.setup.pre,
                decimation=self.setup.decimation,
                complete=complete,
            )
        )

    def _mark_gaps(self, records: np.ndarray, kept: np.ndarray, samples: np.ndarray) -> None:
        """Tell every sample what is missing between it and the one before, in this piece or an earlier one."""
        ticks, missed = records["tick"], np.maximum(records["missed_ticks"].astype(np.int64), 0)
        last = int(ticks[0]) - 1 - int(missed[0]) if self._last_tick is None else self._last_tick
        lost = np.maximum(np.diff(ticks, prepend=last) - 1 - missed, 0)
        self._last_tick = int(ticks[-1])
        for name, new, carried in (("missed", missed, self._missed), ("lost", lost, self._lost)):
            total = carried + np.cumsum(new)
            until = total[kept]
            samples[name] = np.minimum(np.diff(until, prepend=0), np.iinfo(np.int32).max)
            setattr(self, f"_{name}", int(total[-1] - (until[-1] if len(until) else 0)))
