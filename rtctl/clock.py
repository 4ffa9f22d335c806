"""Who may read time: nobody but this file.

The grid clock wakes at absolute deadlines; after an overrun it skips to the next grid point and counts what it skipped.
Lockstep and replay have no clock at all: there the tick number is the time.
"""

import time

import numpy as np
from numba import types

from hal.kernel import kernel
from rtctl.stages import WRITE

MONOTONIC, ABSOLUTE, INTERRUPTED = 1, 1, 4
LONGEST_NS = 2**31 - 1

# by name, not through a function pointer, so that the kernels can be cached
_nanosleep = types.ExternalFunction("clock_nanosleep", types.int32(types.int32, types.int32, types.uintp, types.uintp))
_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.uintp))

CLOCK = np.dtype(
    [
        ("origin_ns", "i8"),
        ("epoch_ns", "i8"),
        ("period_ns", "i8"),
        ("tick", "i8"),
        ("woken_ns", "i8"),
        ("stamp_ns", "i8"),
        ("timespec", "i8", (2,)),
    ],
    align=True,
)
"""A grid clock: tick k is due at origin + k period on the monotonic clock, and is stamped epoch + k period."""


def grid(period_s: float) -> np.ndarray:
    """A grid clock, shape (1,), whose tick 0 lies one period from now."""
    clock = np.zeros(1, CLOCK)
    clock["period_ns"] = round(period_s * 1e9)
    clock["origin_ns"] = time.monotonic_ns() + clock["period_ns"]
    clock["epoch_ns"] = time.time_ns() + clock["period_ns"]
    clock["tick"] = -1
    return clock


@kernel
def now_ns(clock):
    """The monotonic clock [ns]."""
    _gettime(MONOTONIC, clock.timespec.ctypes.data)
    return clock.timespec[0] * 1_000_000_000 + clock.timespec[1]


@kernel
def wait(clock, record):
    """Sleep until the next grid point and stamp the record with it: tick, time_ns, missed_ticks, lateness_ns."""
    due = (now_ns(clock) - clock.origin_ns) // clock.period_ns + 1
    due = max(due, clock.tick + 1)
    record.missed_ticks = due - clock.tick - 1
    clock.tick = due
    deadline = clock.origin_ns + due * clock.period_ns
    result = INTERRUPTED
    while result == INTERRUPTED:
        clock.timespec[0], clock.timespec[1] = deadline // 1_000_000_000, deadline % 1_000_000_000
        result = _nanosleep(MONOTONIC, ABSOLUTE, clock.timespec.ctypes.data, 0)
    clock.woken_ns = clock.stamp_ns = now_ns(clock)
    record.tick = due
    record.time_ns = clock.epoch_ns + due * clock.period_ns
    record.lateness_ns = min(clock.woken_ns - deadline, LONGEST_NS)


@kernel
def stamp(clock, record, stage):
    """End a stage (:mod:`rtctl.stages`): note how long ago the one before it ended, or the wake-up was."""
    now = now_ns(clock)
    record.stage_ns[stage] = min(now - clock.stamp_ns, LONGEST_NS)
    clock.stamp_ns = now


@kernel
def stamp_duration(clock, record):
    """End the last stage before the record is passed on, and note how long the tick has taken since it was woken."""
    stamp(clock, record, WRITE)
    record.tick_ns = min(clock.stamp_ns - clock.woken_ns, LONGEST_NS)
