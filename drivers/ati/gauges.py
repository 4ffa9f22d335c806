"""From six gauge voltages to a wrench, and what raw signals tell before anybody computes one (07 sections 0, 3, 7).

One gauge at its rail spoils all six components, and a cut cable drives every gauge there: hence raw signals, never
resolved forces. Gauges are counted from 1.
"""

import math

import numpy as np

from hal.frames import FROZEN, INVALID, SATURATED, VALID
from hal.kernel import kernel

GAUGES = 6
SETTLED = 5
"""Samples in a row without any gauge at its rail before a wrench is trusted again; the first at the rail ends trust."""
MEMORY = 1.0 / 256
"""Weight of a sample in the running mean of squares."""
BLOW = 4.0
"""A difference of neighbouring samples counts as noise up to so many times the limit: a blow alone is none."""
HIGH_PERCENT, RATED_PERCENT = 80.0, 100.0

RAILED, CABLE, STUCK, HIGH, OVER_RATED, NOISY = (1 << n for n in range(6))
"""Bits of what :func:`take_sample` found."""

TRANSDUCER = np.dtype(
    [
        ("inputs", "i8", (GAUGES,)),
        ("t_out_input", "i8"),  # -1 for none
        ("t_out_low_v", "f8"),
        ("t_out_high_v", "f8"),
        ("thermistor_v", "f8"),  # NaN without compensation
        ("bias_slope", "f8", (GAUGES,)),
        ("gain_slope", "f8", (GAUGES,)),
        ("zero_v", "f8", (GAUGES,)),
        ("to_wrench", "f8", (6, GAUGES)),  # in {F}
        ("to_percent", "f8", (6, GAUGES)),  # of the ratings, in the transducer's own frame
        ("frozen_samples", "i8"),
        ("noise_limit_v", "f8"),
        # state
        ("code", "i8", (GAUGES,)),
        ("same", "i8", (GAUGES,)),
        ("gauge_v", "f8", (GAUGES,)),  # compensated
        ("last_v", "f8", (GAUGES,)),
        ("square", "f8", (GAUGES,)),
        ("connected", "i8"),  # last_v holds the sample before
        ("clean", "i8"),  # samples in a row without a rail
        ("railed", "i8"),
        ("stuck", "i8"),
        ("noise_v", "f8"),
        ("load_percent", "f8"),
    ],
    align=True,
)
"""Settings and state of one transducer."""


@kernel
def take_sample(state, code, voltage_v, railed, wrench):
    """Take in a new scan of the card; a repeated one must not be given again.

    Args:
        state (1,): of TRANSDUCER. code, voltage_v, railed: all inputs of the card.
        wrench (6,): result in {F} [N, N mm]; only to be used if VALID is returned.

    Returns:
        (validity, found): found is a set of the bits of this module.
    """
    t = state[0]
    railed_gauges = follow_words(t, code, railed)
    warmth_v, cable_off = listen_to_t_out(t, voltage_v, railed)
    if railed_gauges > 0:
        t.clean = t.connected = 0
        return SATURATED, CABLE if cable_off or railed_gauges == GAUGES else RAILED
    t.clean += 1
    follow_noise(t, voltage_v)
    if cable_off:
        return INVALID, CABLE
    if t.clean < SETTLED:
        return SATURATED, 0
    if t.stuck > 0:
        return FROZEN, STUCK
    resolve(t, voltage_v, warmth_v, wrench)
    if not math.isfinite(t.load_percent):
        return INVALID, 0
    found = NOISY if t.noise_v > t.noise_limit_v else 0
    if t.load_percent >= RATED_PERCENT:
        found |= OVER_RATED
    elif t.load_percent >= HIGH_PERCENT:
        found |= HIGH
    return VALID, found


@kernel
def follow_words(t, code, railed):
    """Count repeated converter words, gauge by gauge; returns how many gauges are at their rails."""
    count = t.stuck = t.railed = 0
    for i in range(GAUGES):
        channel = t.inputs[i]
        t.same[i] = t.same[i] + 1 if code[channel] == t.code[i] else 0
        t.code[i] = code[channel]
        if t.same[i] >= t.frozen_samples and t.stuck == 0:
            t.stuck = i + 1
        if railed[channel]:
            count += 1
            if t.railed == 0:
                t.railed = i + 1
    return count


@kernel
def listen_to_t_out(t, voltage_v, railed):
    """How much warmer than at calibration [V], and whether the transducer's cable is off."""
    if t.t_out_input < 0:
        return 0.0, False
    t_out_v = voltage_v[t.t_out_input]
    on = t_out_v >= t.t_out_low_v and t_out_v <= t.t_out_high_v and not railed[t.t_out_input]
    return t_out_v - t.thermistor_v if t.thermistor_v == t.thermistor_v else 0.0, not on


@kernel
def follow_noise(t, voltage_v):
    """Noise of the noisiest gauge, from differences of neighbouring samples: a load that changes slowly is none."""
    most, largest = (BLOW * t.noise_limit_v) ** 2, 0.0
    for i in range(GAUGES):
        v = voltage_v[t.inputs[i]]
        if t.connected:
            step = v - t.last_v[i]
            t.square[i] += MEMORY * (min(step * step, most) - t.square[i])
        t.last_v[i] = v
        largest = max(largest, t.square[i])
    t.connected = 1
    t.noise_v = math.sqrt(0.5 * largest)


@kernel
def resolve(t, voltage_v, warmth_v, wrench):
    """Wrench and load of the gauges, compensated for temperature (07 section 3.2)."""
    for i in range(GAUGES):
        v = voltage_v[t.inputs[i]]
        t.gauge_v[i] = (v + t.bias_slope[i] * warmth_v) / (1.0 - t.gain_slope[i] * warmth_v)
    t.load_percent = 0.0
    for i in range(6):
        force = percent = 0.0
        for j in range(GAUGES):
            v = t.gauge_v[j] - t.zero_v[j]
            force += t.to_wrench[i, j] * v
            percent += t.to_percent[i, j] * v
        wrench[i] = force
        if not abs(percent) <= t.load_percent:  # NaN counts
            t.load_percent = abs(percent)
