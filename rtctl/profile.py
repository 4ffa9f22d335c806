"""Piecewise cubic motion profiles: built on a change of goal, evaluated every tick.

A profile moves every channel (the pose coordinates, then the insertion depth) by pieces of constant jerk.
Moves to a position are planned by ruckig (:mod:`rtctl.propose`); changes of velocity, and with them every brake,
are built here in closed form, so that stopping never depends on a planner.
"""

import math

from hal.kernel import kernel


@kernel
def clear(profile, tick):
    """Start an empty profile at `tick`."""
    profile.start_tick = tick
    profile.valid = 1
    profile.reason = 1
    profile.reason_value = math.nan
    profile.reason_bound = math.nan
    profile.duration_s = 0.0
    for c in range(profile.segments.shape[0]):
        profile.segments[c] = 0


@kernel
def append(profile, channel, start_s, position, velocity, acceleration, jerk):
    """Add one piece that begins at `start_s` after the start; it lasts until the next piece, or for ever."""
    k = profile.segments[channel]
    profile.start_s[channel, k] = start_s
    profile.position[channel, k] = position
    profile.velocity[channel, k] = velocity
    profile.acceleration[channel, k] = acceleration
    profile.jerk[channel, k] = jerk
    profile.segments[channel] = k + 1


@kernel
def append_velocity_change(profile, channel, position, velocity, acceleration, target, limit_acceleration, limit_jerk):
    """Bring one channel from (position, velocity, acceleration) to `target` velocity without acceleration.

    Time-optimal within the limits: jerk to a peak acceleration, hold it, jerk back. The velocity that would be left
    if the acceleration were removed at once, v + a|a|/2j, decides the direction.
    """
    coast = velocity + 0.5 * acceleration * abs(acceleration) / limit_jerk
    direction = 1.0 if coast <= target else -1.0
    start = direction * acceleration
    change = direction * (target - velocity)
    peak = math.sqrt(max(limit_jerk * change + 0.5 * start * start, 0.0))
    hold = 0.0
    if peak > limit_acceleration:
        peak = max(limit_acceleration, start)
        hold = (change - (2.0 * peak * peak - start * start) / (2.0 * limit_jerk)) / peak
    rise = (peak - start) / limit_jerk
    fall = peak / limit_jerk
    time = 0.0
    for piece in range(3):
        duration = rise if piece == 0 else hold if piece == 1 else fall
        jerk = limit_jerk if piece == 0 else 0.0 if piece == 1 else -limit_jerk
        jerk *= direction
        if duration > 0.0:
            append(profile, channel, time, position, velocity, acceleration, jerk)
            position += duration * (velocity + duration * (0.5 * acceleration + duration * jerk / 6.0))
            velocity += duration * (acceleration + 0.5 * duration * jerk)
            acceleration += duration * jerk
            time += duration
    append(profile, channel, time, position, target, 0.0, 0.0)
    profile.duration_s = max(profile.duration_s, time)


@kernel
def evaluate(profile, channel, time_s):
    """(position, velocity, acceleration) of one channel, `time_s` after the start of the profile."""
    k = profile.segments[channel] - 1
    while k > 0 and time_s < profile.start_s[channel, k]:
        k -= 1
    t = time_s - profile.start_s[channel, k]
    p, v = profile.position[channel, k], profile.velocity[channel, k]
    a, j = profile.acceleration[channel, k], profile.jerk[channel, k]
    return p + t * (v + t * (0.5 * a + t * j / 6.0)), v + t * (a + 0.5 * t * j), a + t * j


@kernel
def final_position(profile, channel):
    """Position of the last piece at its start: where a profile that ends at rest stays."""
    return profile.position[channel, profile.segments[channel] - 1]
