"""Parameters and state of one axis, as the kernels of :mod:`drivers.maxon_lsc.watch` want them."""

import numpy as np

from drivers.maxon_lsc.options import GAINS, LscOptions
from hal.errors import OptionError

MODES = {mode: number for number, mode in enumerate(GAINS)}
CURRENT, SPEED, VOLTAGE = MODES["current"], MODES["speed"], MODES["voltage"]
RING = 256
"""Counts kept to judge the way of a motor."""

AXIS = np.dtype(
    [
        ("axis", "i8"),
        ("counter", "i8"),
        ("ready_line", "i8"),
        ("rad_per_count", "f8"),  # with the encoder's direction
        ("period_s", "f8"),
        ("most_counts", "f8"),  # in a tick
        ("turn_counts", "i8"),  # of the motor, 0 without index
        ("direction", "i8"),
        ("breakaway_v", "f8"),
        ("stall_ticks", "i8"),
        ("half_window", "i8"),
        ("mode", "i8"),
        ("gain", "f8"),
        ("resistance_ohm", "f8"),
        ("back_emf_v_s_per_rad", "f8"),
        ("continuous_a", "f8"),
        ("peak_a", "f8"),
        ("heat_per_tick", "f8"),
        # state
        ("tick", "i8"),
        ("sampled", "i8"),  # tick of the last new count, -1 for none
        ("sequence", "i8"),
        ("zero", "i8"),
        ("count", "i8"),
        ("angle_rad", "f8"),
        ("speed_rad_per_s", "f8"),
        ("jumped_by", "i8"),  # counts of the last step if they were too many
        ("doubted", "i8"),  # the last count is too far, and the next read will tell why
        ("doubt_count", "i8"),  # the count before it
        ("doubt_tick", "i8"),
        ("illegal", "i8"),  # the last count came with an error
        ("index_seen", "i8"),  # -1: no sample yet
        ("index_first", "i8"),
        ("index_known", "i8"),
        ("index_off_by", "i8"),
        ("index_place", "i8"),  # count when the last pulse was seen, or when opened
        ("still_place", "i8"),
        ("still_ticks", "i8"),
        ("push", "i8"),
        ("filled", "i8"),
        ("heat", "f8"),  # share of what the continuous current makes of the winding for ever
        ("hot", "i8"),
        ("high_reads", "i8"),
        ("low_reads", "i8"),
        ("fault", "i8"),
        ("was_ready", "i8"),  # since opened
        ("ring", "i8", (RING,)),
    ],
    align=True,
)


def axis_state(o: LscOptions, period_s: float, where: str) -> np.ndarray:
    """A fresh state (1,) of AXIS. Raises OptionError for a window that does not fit."""
    state = np.zeros(1, AXIS)
    s = state[0]
    s["axis"], s["counter"], s["ready_line"] = o.axis, o.counter, o.ready_line
    s["rad_per_count"] = o.encoder_direction / o.counts_in_rad
    s["period_s"], s["direction"], s["breakaway_v"] = period_s, o.encoder_direction, o.breakaway_v
    s["most_counts"] = o.max_speed_rad_per_s * o.counts_in_rad * period_s
    s["turn_counts"] = 4 * o.lines if o.index and o.lines is not None else 0
    s["stall_ticks"] = max(round(o.stall_s / period_s), 1)
    s["half_window"] = max(round(o.wrong_way_s / period_s) // 2, 2)
    if 2 * s["half_window"] >= RING:
        raise OptionError(f"{where}.wrong_way_s is out of bounds", value=o.wrong_way_s, bound=f"below {RING * period_s:g} s at this period")  # fmt: skip
    s["mode"], s["gain"] = MODES[o.mode], getattr(o, GAINS[o.mode])
    s["resistance_ohm"], s["back_emf_v_s_per_rad"] = o.resistance_ohm or 1.0, o.back_emf_v_s_per_rad or 0.0
    s["continuous_a"], s["peak_a"], s["heat_per_tick"] = o.continuous_a, o.peak_a, period_s / o.thermal_s
    s["tick"] = s["sampled"] = s["sequence"] = s["index_seen"] = -1
    return state
