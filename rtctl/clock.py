"""Who may read time: nobody but this file.

The grid clock wakes at absolute deadlines; after an overrun it skips to the next grid point and counts what it skipped. The
device clock is the same grid, moved a little after every tick to stay with a device (:mod:`rtctl.device_clock`).
Lockstep and replay have no clock at all: there the tick number is the time.
"""

import time

import numpy as np
from numba import types

from hal.kernel import kernel
from rtctl.device_clock import FOLLOWER, GRID, WATCHING, move_ns
from rtctl.settings import Loop
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
        ("spin_ns", "i8"),
        ("tick", "i8"),
        ("due_ns", "i8"),
        ("woken_ns", "i8"),
        ("interrupted", "i8"),
        ("stamp_ns", "i8"),
        ("timespec", "i8", (2,)),
        ("follower", FOLLOWER),
    ],
    align=True,
)
"""A grid clock: tick k is due at origin + k period on the monotonic clock, and is stamped epoch + k period.

The last spin_ns before it are not slept. interrupted: a signal came during a sleep. What follows a device moves origin and epoch together."""


def grid(period_s: float) -> np.ndarray:
    """A grid clock, shape (1,), whose tick 0 lies one period from now."""
    clock = np.zeros(1, CLOCK)
    clock["period_ns"] = round(period_s * 1e9)
    clock["origin_ns"] = time.monotonic_ns() + clock["period_ns"]
    clock["epoch_ns"] = time.time_ns() + clock["period_ns"]
    clock["tick"] = -1
    return clock


def make(loop: Loop) -> np.ndarray:
    """The clock, shape (1,), that the settings ask for; tick 0 lies one period from now."""
    clock = grid(loop.period_s)
    clock["spin_ns"] = loop.spin_us * 1000
    if loop.clock == "device":
        clock["follower"]["state"], clock["follower"]["phase_ns"] = WATCHING, loop.device_phase_s * 1e9
    return clock


@kernel
def now_ns(clock):
    """The monotonic clock [ns]."""
    _gettime(MONOTONIC, clock.timespec.ctypes.data)
    return clock.timespec[0] * 1_000_000_000 + clock.timespec[1]


@kernel
def wait(clock, record):
    """Sleep until the next grid point and stamp the record with it."""
    claim(clock, now_ns(clock), record)
    asleep_ns = clock.due_ns - clock.spin_ns
    result = INTERRUPTED
    while result == INTERRUPTED:
        clock.timespec[0], clock.timespec[1] = asleep_ns // 1_000_000_000, asleep_ns % 1_000_000_000
        result = _nanosleep(MONOTONIC, ABSOLUTE, clock.timespec.ctypes.data, 0)
        if result == INTERRUPTED:
            clock.interrupted = 1
    woken = now_ns(clock)
    while woken < clock.due_ns:
        woken = now_ns(clock)
    clock.woken_ns = clock.stamp_ns = woken
    record.lateness_ns = min(woken - clock.due_ns, LONGEST_NS)


@kernel
def claim(clock, now_ns, record):
    """Choose the first grid point after `now_ns` that had no tick: tick, time_ns, missed_ticks, clock_state."""
    due = (now_ns - clock.origin_ns) // clock.period_ns + 1
    due = max(due, clock.tick + 1)
    record.missed_ticks = due - clock.tick - 1
    record.tick = clock.tick = due
    record.time_ns = clock.epoch_ns + due * clock.period_ns
    record.clock_state = clock.follower.state
    clock.due_ns = clock.origin_ns + due * clock.period_ns


@kernel
def follow(clock, device_time_s, record):
    """Move the grid towards the device whose clock showed `device_time_s` at the wake-up, if one is followed."""
    follower = clock.follower
    if follower.state == GRID:
        record.clock_error_s, record.clock_moved_ns = np.nan, 0
        return
    moved = move_ns(follower, clock.tick, clock.period_ns, clock.due_ns, clock.woken_ns, device_time_s)
    clock.origin_ns += moved
    clock.epoch_ns += moved
    record.clock_error_s, record.clock_moved_ns = follower.error_ns * 1e-9, moved


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
