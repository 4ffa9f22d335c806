"""The order of samples: losses, doubles, late ones, and a sender that started anew (07 section 4)."""

import enum

from drivers.cim.sample import Sample

RESTARTED_US = 1_000_000
"""A layout without runs: time that goes back by more than this is another start, not a late datagram."""
WRAP = 1 << 32


class Verdict(enum.Enum):
    """What a sample is to those before it."""

    NEXT = 0
    NEW_RUN = 1
    """the sender started anew; also a length of sweep or a clock that can only be of another start"""
    OLD = 2
    """a double or late: not to be used"""


def signed_difference(later: int, earlier: int) -> int:
    """later - earlier of two 32-bit counters, -2^31 .. 2^31 - 1."""
    return (later - earlier + WRAP // 2) % WRAP - WRAP // 2


class Stream:
    """Judges samples one after the other.

    Attributes:
        lost: samples the last one judged shows to be missing before it, by number or by time.
        counts: lost, doubles, late, odd_steps (time between neighbours off by more than half), odd_order, runs.
    """

    def __init__(self, sample_period_s: float) -> None:
        self._period_us = sample_period_s * 1e6
        self._last: Sample | None = None
        self.lost = 0
        self.counts = dict.fromkeys(("lost", "doubles", "late", "odd_steps", "odd_order", "runs"), 0)

    def judge(self, sample: Sample) -> Verdict:
        """What `sample` is; unless it is OLD, the next one is compared with it."""
        last, self.lost = self._last, 0
        if last is None or self._is_new_run(sample, last):
            self._last = sample
            self.counts["runs"] += 1
            return Verdict.NEXT if last is None else Verdict.NEW_RUN
        steps = self._steps(sample, last)
        if steps <= 0 or sample.time_us <= last.time_us:
            self.counts["doubles" if steps == 0 else "late"] += 1
            return Verdict.OLD
        self._count(sample, last, steps)
        self._last = sample
        return Verdict.NEXT

    def is_of_another_sweep(self, sample: Sample) -> bool:
        """True if the sweep has another length than before in the same run, which no sender may do."""
        last = self._last
        return last is not None and sample.run == last.run and sample.sweep_length != last.sweep_length

    def _is_new_run(self, sample: Sample, last: Sample) -> bool:
        if sample.run is not None:
            return sample.run != last.run
        return sample.time_us < last.time_us - RESTARTED_US

    def _steps(self, sample: Sample, last: Sample) -> int:
        if sample.sequence is not None and last.sequence is not None:
            return signed_difference(sample.sequence, last.sequence)
        return (sample.time_us > last.time_us) - (sample.time_us < last.time_us)

    def _count(self, sample: Sample, last: Sample, steps: int) -> None:
        periods = (sample.time_us - last.time_us) / self._period_us
        self.lost = max(steps, round(periods)) - 1
        self.counts["lost"] += self.lost
        self.counts["odd_steps"] += not 0.5 <= periods / steps <= 1.5
        if sample.position is not None and last.position is not None and sample.sweep_length:
            due = (last.position + steps) % sample.sweep_length
            sweeps = (last.position + steps) // sample.sweep_length
            in_order = sample.position == due and signed_difference(sample.sweep, last.sweep) == sweeps
            self.counts["odd_order"] += not in_order
