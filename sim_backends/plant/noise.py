"""Noise that depends on seed, tick and channel only: the same run gives the same bytes, however it was interrupted.

A counter goes through the splitmix64 finaliser (Steele, Lea and Flood 2014); Box and Muller make normals of it.
"""

import math

import numpy as np

from hal.kernel import kernel

_STEP = np.uint64(0x9E3779B97F4A7C15)
_MIX1, _MIX2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_UNIT = 2.0**-53


@kernel
def uniform(seed, counter):
    """A number in (0, 1) for (seed, counter), both uint64."""
    z = seed + counter * _STEP
    z = (z ^ (z >> _30)) * _MIX1
    z = (z ^ (z >> _27)) * _MIX2
    z = z ^ (z >> _31)
    return (float(z >> _11) + 0.5) * _UNIT


@kernel
def normal_pair(seed, counter):
    """Two independent standard normals for (seed, counter)."""
    double = counter + counter
    radius = math.sqrt(-2.0 * math.log(uniform(seed, double)))
    angle = 2.0 * math.pi * uniform(seed, double + np.uint64(1))
    return radius * math.cos(angle), radius * math.sin(angle)


@kernel
def normals(seed, tick, out):
    """Fill `out` (an even number of values) with the standard normals of `tick` (int64)."""
    pairs = out.shape[0] // 2
    for k in range(pairs):
        out[2 * k], out[2 * k + 1] = normal_pair(seed, np.uint64(tick * pairs + k))
