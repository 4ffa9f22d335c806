"""The grid follows a device: a phase-locked loop of bounded correction, pure arithmetic without a clock of its own.

A drive or a converter samples at the beat of its own crystal. Seen from there the grid of this machine drifts, by a tick
every few seconds, and then a sample is met twice or not at all. So the device tells its time at every read, and the grid
is moved a little after every tick, until tick k is due at a fixed place in the device's period and stays there:

    e = device time at the grid point - (k + cycle) T - phase
    move = -(K_p e + r), at most SLEW_LIMIT T;     r <- r + K_i e, at most RATE_LIMIT T

A time that cannot be true moves nothing. It has to go well with the clock of this machine for PROOF_TICKS before it is
followed, and is refused as soon as it does not: when it is no number, when it jumps against this machine's by more than JUMP
of a period between two reads, and when it runs away by more than LOST of a period although the grid is moved as fast as may
be. Refused means: the grid goes on as it is, by the crystal of this machine, and the proof begins anew.
"""

import enum
import math

import numpy as np

from hal.kernel import kernel

SLEW_LIMIT = 1e-3
"""Most the grid is moved in a tick, in periods: 1000 ppm, 1 us at 1 kHz."""
RATE_LIMIT = 5e-4
"""Largest difference of two crystals that is believed: 500 ppm; honest ones differ by 100."""
JUMP = 0.1
"""In periods; above what a bus makes of the moment at which the device's time was taken."""
LOST = 0.75
"""In periods, from the beat chosen when the pull began, which is half a period away at most."""
PROOF_TICKS = 1000
K_P, K_I = 0.02, 1e-4
"""Critically damped: K_i = K_p^2 / 4; a time constant of 100 ticks averages the jitter of the device's time."""
LOCKED_WITHIN = 0.02
"""In periods; for LOCKED_TICKS on end."""
LOCKED_TICKS = 100


class ClockState(enum.IntEnum):
    """How the grid and the device stand to each other."""

    GRID = 0
    """nobody is followed: `loop.clock` is "grid" """
    WATCHING = 1
    """the device's time is looked at, and not yet believed"""
    PULLING = 2
    LOCKED = 3
    REFUSED = 4
    """the device's time cannot be true; the grid is held"""


GRID, WATCHING, PULLING, LOCKED, REFUSED = (int(s) for s in ClockState)

FOLLOWER = np.dtype(
    [
        ("state", "i8"),
        ("phase_ns", "f8"),  # where in the device's period a tick is due
        ("cycle", "i8"),  # number of the device's period less that of the tick
        ("rate_ns", "f8"),  # by how much the device's periods are shorter than ours
        ("rest_ns", "f8"),  # of a move, below 1 ns
        ("error_ns", "f8"),
        ("settled", "i8"),  # ticks within LOCKED_WITHIN
        ("proof", "i8"),  # plausible times on end, 0 for none
        ("first_device_ns", "f8"),
        ("first_woken_ns", "i8"),
        ("last_device_ns", "f8"),
        ("last_woken_ns", "i8"),
    ],
    align=True,
)


@kernel
def move_ns(follower, tick, period_ns, due_ns, woken_ns, device_time_s):
    """How far the grid is to be moved before the next tick [ns, a whole number].

    tick: the one under way, due at due_ns and woken at woken_ns on the clock of this machine. device_time_s: what the
    device's clock showed at woken_ns, NaN if that is not known.
    """
    f, device_ns = follower, device_time_s * 1e9
    f.error_ns = math.nan
    if not is_plausible(f, period_ns, woken_ns, device_ns):
        refuse(f)
        return 0
    f.last_device_ns, f.last_woken_ns = device_ns, woken_ns
    f.proof += 1
    if f.proof == 1:
        f.first_device_ns, f.first_woken_ns = device_ns, woken_ns
    at_due_ns = device_ns - (woken_ns - due_ns) * (1.0 + f.rate_ns / period_ns) - f.phase_ns
    if f.state == WATCHING or f.state == REFUSED:
        if f.proof > PROOF_TICKS:
            believe(f, tick, period_ns, at_due_ns)
        return 0
    error = at_due_ns - (tick + f.cycle) * period_ns
    if abs(error) > LOST * period_ns:
        refuse(f)
        return 0
    f.error_ns = error
    f.settled = f.settled + 1 if abs(error) <= LOCKED_WITHIN * period_ns else 0
    f.state = LOCKED if f.settled >= LOCKED_TICKS else PULLING
    return controlled(f, error, period_ns)


@kernel
def is_plausible(follower, period_ns, woken_ns, device_ns):
    """Whether the device's time is a number, and went on since the last read as this machine's did."""
    if not abs(device_ns) < 1e18:
        return False
    if follower.proof == 0:
        return True
    passed = float(woken_ns - follower.last_woken_ns)
    return abs(device_ns - follower.last_device_ns - passed) <= JUMP * period_ns + SLEW_LIMIT * passed


@kernel
def refuse(follower):
    """Hold the grid, and forget what was believed."""
    follower.state = REFUSED
    follower.proof = follower.settled = 0
    follower.rate_ns = follower.rest_ns = 0.0


@kernel
def believe(follower, tick, period_ns, at_due_ns):
    """End of the proof: the mean rate over it and the nearest beat are where the pull begins; or it all begins anew."""
    f = follower
    passed = float(f.last_woken_ns - f.first_woken_ns)
    rate = (f.last_device_ns - f.first_device_ns - passed) / passed
    if abs(rate) > RATE_LIMIT:
        refuse(f)
        return
    f.cycle = math.floor(at_due_ns / period_ns + 0.5) - tick
    f.rate_ns = rate * period_ns
    f.state = PULLING


@kernel
def controlled(follower, error_ns, period_ns):
    """The move of proportional and integral part; the latter rests while the move is at its limit."""
    f = follower
    limit, most = SLEW_LIMIT * period_ns, RATE_LIMIT * period_ns
    wanted = K_P * error_ns + f.rate_ns
    if abs(wanted) <= limit:
        f.rate_ns = min(max(f.rate_ns + K_I * error_ns, -most), most)
    exact = f.rest_ns - min(max(wanted, -limit), limit)
    whole = math.floor(exact + 0.5)
    f.rest_ns = exact - whole
    return whole
