"""The crystal of a simulated bench that has a clock of its own: the one part of the plant that looks at one.

Everything else here knows the tick number alone. What this clock shows can pace a loop in real time (`loop.clock`), and goes
nowhere else: neither into the physics, nor into a record, so that lockstep and replay do not depend on it.
"""

import math

import numpy as np
from numba import types

from hal.kernel import kernel

MONOTONIC = 1
CRYSTAL = np.dtype([("rate", "f8"), ("timespec", "i8", (2,))], align=True)
"""rate: of its seconds to those of this machine, NaN where there is no such clock."""

# by name, not through a function pointer, so that the kernels can be cached
_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.uintp))


def pack(ppm: float | None, crystal: np.void) -> None:
    """Fill a CRYSTAL record: one that is `ppm` faster than this machine's, or none."""
    crystal["rate"] = math.nan if ppm is None else 1.0 + ppm * 1e-6


@kernel
def time_s(crystal):
    """What the clock shows now [s]; NaN if there is none."""
    if math.isnan(crystal.rate):
        return math.nan
    _gettime(MONOTONIC, crystal.timespec.ctypes.data)
    return crystal.rate * (crystal.timespec[0] + 1e-9 * crystal.timespec[1])
