"""The sender's clock seen from here: when was a sample taken, in our time? (07 section 4)."""

WINDOW = 200
"""Samples in each half of the window, some 14 s: long enough to meet a fast datagram, short for two quartz clocks to drift."""


class SenderClock:
    """Maps sample times by the smallest delay met, newest half of the window and the one before.

    A datagram cannot arrive before it is sent, so the smallest difference of the two clocks is the one nearest to the truth,
    and no age comes out younger than since arrival.
    """

    def __init__(self) -> None:
        self._offset_us: int | None = None
        self._offset_before_us: int | None = None
        self._count = 0

    def host_us(self, time_us: int, arrival_us: int) -> int:
        """Host time [us] of a sample taken at the sender's `time_us` that arrived at the host's `arrival_us`."""
        if self._count == WINDOW:
            self._offset_before_us, self._offset_us, self._count = self._offset_us, None, 0
        self._count += 1
        offset = arrival_us - time_us
        self._offset_us = offset if self._offset_us is None else min(offset, self._offset_us)
        before = self._offset_us if self._offset_before_us is None else self._offset_before_us
        return time_us + min(self._offset_us, before)
