"""What is known of the telemetry since the device was opened: the sample to pass on, and what is wrong."""

from collections import deque
from math import nan

from drivers.cim.memory import PairMemory
from drivers.cim.sample import Sample
from drivers.cim.sender_clock import SenderClock

QUEUE = 42
"""Samples that may wait to be passed on, two sweeps."""
OPEN_READS_OHM, SHORT_READS_OHM = 28_800.0, 20.0
"""What is passed on when the sender itself says open or short, whatever number comes with it."""
REARM_SWEEPS = 2


class Session:
    """Keeps the samples of a stream and passes them on one a tick.

    Attributes:
        ohm, pair, sample_tick: of the sample passed on last; pair -1 for none of this run. delivered: how many were, ever.
        newest_tick: when the newest sample was taken, in our time; None before the first of a run.
        armed_from: tick from which samples are passed on again after the sender started anew.
        stale: pairs not heard for two sweeps. repeated: sweeps in a row in which all pairs read the same.
        overflows: samples lost because too many waited. withheld: because of a new run.
    """

    def __init__(self, pairs: int, sweep_ticks: int, period_us: float) -> None:
        self._pairs, self._sweep_ticks, self._period_us = pairs, sweep_ticks, period_us
        self.armed_from = self.overflows = self.withheld = self.delivered = 0
        self._gap = self._gap_until = 0
        self._begin_run()

    def _begin_run(self) -> None:
        self._clock = SenderClock()
        self._memory = PairMemory(self._pairs, self._sweep_ticks)
        self._queue = deque[tuple[float, int, int]]()
        self.newest_tick: int | None = None
        self.ohm, self.pair, self.sample_tick = nan, -1, 0
        self.stale = self.repeated = 0

    def start_anew(self, tick: int) -> None:
        """Another run: what is known is of another sender, and so long nothing is passed on that nobody remembers it."""
        self.armed_from = tick + REARM_SWEEPS * self._sweep_ticks
        self._begin_run()

    def hear(self, tick: int, sample: Sample, pair: int) -> None:
        """Take in a sample that arrived at `tick`."""
        taken_us = self._clock.host_us(sample.time_us, round(tick * self._period_us))
        self.newest_tick = min(tick, round(taken_us / self._period_us))
        self._memory.hear(pair, sample.ohm, tick)
        self.stale, self.repeated = self._memory.stale(tick), self._memory.repeated_sweeps(tick)
        if tick < self.armed_from:
            self.withheld += 1
            return
        if len(self._queue) == QUEUE:
            self._queue.popleft()
            self.overflows += 1
            self.lose(tick, 1)
        self._queue.append((believed_ohm(sample), pair, self.newest_tick))

    def pass_on(self) -> None:
        """The next sample, if one waits."""
        if self._queue:
            self.ohm, self.pair, self.sample_tick = self._queue.popleft()
            self.delivered += 1

    def lose(self, tick: int, lost: int) -> None:
        """So many samples are missing; that is worth telling for a sweep."""
        if lost > 0:
            self._gap = lost + (self._gap if tick < self._gap_until else 0)
            self._gap_until = tick + self._sweep_ticks

    def missing(self, tick: int) -> int:
        """Samples lost of late, or else pairs that are stale."""
        return self._gap if tick < self._gap_until else self.stale


def believed_ohm(sample: Sample) -> float:
    """The magnitude, or what an open circuit or a short reads where the sender says that it is one.

    A stimulator at its compliance limit drove less current than it divides by: the impedance is too large to be told.
    """
    if sample.is_open or sample.at_compliance:
        return max(sample.ohm, OPEN_READS_OHM)
    return min(sample.ohm, SHORT_READS_OHM) if sample.is_short else sample.ohm
