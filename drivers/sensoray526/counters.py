"""The encoders' counters: how they are set up and read, and what the words mean (07 sections 1.2 and 1.3)."""

from numba.types import UniTuple, boolean, int32, int64

from drivers.sensoray526.registers import (
    ERROR_CAPTURED,
    EVENTS,
    INDEX_FELL,
    INDEX_ROSE,
    LATCH_AT_FALL,
    LATCH_AT_RISE,
    LATCH_ON_EVENT,
    LOAD,
    RUNNING,
    SELECT_PRELOAD_1,
    Batch,
    counter_control,
    counter_high,
    counter_low,
    counter_mode,
)
from hal.kernel import kernel

DECODE = UniTuple(int64, 2)(
    int32[:, :], int64[:], int64, int64, int64[:], int64[:], boolean[:], int64[:], int64[:], int32[:]
)  # fmt: skip
"""Compiled when it is imported, and so by `rtctl warmup`: the first tick is no time for it."""
WRAP = 1 << 24
HALF = 1 << 23


def index_event(edge: str) -> tuple[int, int]:
    """Event flag of an index edge, and the control bit by which it latches."""
    return (INDEX_ROSE, LATCH_AT_RISE) if edge == "rising" else (INDEX_FELL, LATCH_AT_FALL)


def add_setup(batch: Batch, channel: int, *, index: bool, latch_at: int) -> None:
    """Load zero from either preload register, then count four edges a line, and latch at the index."""
    for preload in (0, SELECT_PRELOAD_1):
        batch.write(counter_mode(channel), preload)
        batch.write(counter_high(channel), 0)
        batch.write(counter_low(channel), 0)
    batch.write(counter_control(channel), LOAD)
    batch.write(counter_control(channel), EVENTS | (latch_at if index else 0))
    batch.write(counter_mode(channel), RUNNING | (LATCH_ON_EVENT if index else 0))


def add_reading(batch: Batch, channel: int, *, index: bool) -> None:
    """Events and count; with an index first what it latched, because reading the count overwrites that.

    A latch holds one thing. Between the ticks it waits for the index; for the few accesses in which the count is read
    it latches on read.
    """
    batch.read(counter_control(channel))
    if index:
        batch.read(counter_low(channel))
        batch.read(counter_high(channel))
        batch.write(counter_mode(channel), RUNNING)
    batch.read(counter_low(channel))
    batch.read(counter_high(channel))
    if index:
        batch.write(counter_mode(channel), RUNNING | LATCH_ON_EVENT)


def words_a_reading(*, index: bool) -> int:
    """Operations of :func:`add_reading`."""
    return 7 if index else 3


@kernel
def wrapped(delta):
    """A difference of 24-bit counts as the smallest step that explains it, -2^23 .. 2^23 - 1."""
    return (delta + HALF) % WRAP - HALF


@kernel(signature=DECODE)
def decode(words, channels, index_flag, control, raw, count, error, index_count, index_sequence, clear):
    """Take over what the counters of `channels` (k,) showed in this tick.

    Args:
        words: (k, words_a_reading) results of add_reading.
        index_flag: event of the index, 0 without one. control: what the control register shall hold beside its events.
        raw: (counters,) 24 bits of the last read, updated. count, error, index_count, index_sequence: (counters,) as in
            hal.card.AnalogCard, updated.
        clear: (k,) words to write to the control registers, so that exactly the events seen are cleared.

    Returns:
        how many counters saw an illegal step; how many index pulses latched nothing that lies on the way from the last
        count to this one.
    """
    wrong = missed = 0
    last = words.shape[1] - (2 if index_flag else 1)
    for i in range(len(channels)):
        channel = channels[i]
        events = words[i, 0] & EVENTS
        now = (words[i, last] & 0xFF) << 16 | words[i, last - 1]
        step = wrapped(now - raw[channel])
        if events & index_flag:
            latched = (words[i, 2] & 0xFF) << 16 | words[i, 1]
            part = wrapped(latched - raw[channel])
            if min(0, step) <= part <= max(0, step):
                index_count[channel] = count[channel] + part
                index_sequence[channel] += 1
            else:
                missed += 1
        raw[channel] = now
        count[channel] += step
        error[channel] = events & ERROR_CAPTURED != 0
        wrong += error[channel]
        clear[i] = control | events
    return wrong, missed
