"""Bipolar impedance of the electrode's contacts, one pair after the other (04 sections 3 and 4, 07 section 4).

Contacts count from the tip, 0 to 21. Pair k is contacts k and k + `pair_step`; a sweep goes through the pairs from the
tip on and begins again. The fluid between a pair and the modiolar wall has the area A = (d + d') / 2 * pitch, whatever
the step: the power law z = a A^b + c was fitted to that area. Fluid there is only inside the cochlea; a pair of which a
contact is not, and one with a broken lead, is an open circuit.

A sample is taken every `period_ticks` of the session, so it depends on the tick number, the seed and the distances at
that tick alone. The array's owner writes `modiolar_distance_mm` every tick; `contact_from_tip_mm` says where to look.
"""

import math

import numpy as np

from hal.errors import OptionError
from hal.kernel import kernel
from sim_backends.plant.noise import normal_pair
from sim_backends.plant.options import Impedance, Inject

CONTACTS = 22
OPEN_OHM = 28_800.0
"""What the implant's telemetry says of an open circuit; it is also the largest value it can say."""
SHORT_OHM = 20.0
"""Two leads that touch."""
LEAST_OHM = 1.0
STALE_S = 0.5
"""After so long without a sample the link counts as dead (07 section 4)."""
NEVER_TICKS = 2**62

_STREAM = np.uint64(0xB5297A4D3F84D5B5)
"""Makes another stream of noise of the bench's seed: the wrench's stays what it is."""

IMPEDANCE = np.dtype(
    [
        ("factor_ohm", "f8"),  # a
        ("exponent", "f8"),  # b
        ("far_field_ohm", "f8"),  # c
        ("area_max_mm2", "f8"),
        ("distance_min_mm", "f8"),
        ("pitch_mm", "f8"),
        ("noise_ohm", "f8"),
        ("series_ohm", "f8", (CONTACTS,)),  # of a lead; a pair has two
        ("contact_from_tip_mm", "f8", (CONTACTS,)),
        ("pair_step", "i8"),
        ("bath", "i8"),
        ("period_ticks", "i8"),
        ("stale_ticks", "i8"),
        ("silent_ticks", "i8"),
        ("open_ticks", "i8"),
        ("open_channel", "i8"),
        ("short_ticks", "i8"),
        ("short_channel", "i8"),
        ("modiolar_distance_mm", "f8", (CONTACTS,)),  # true, contact surface to wall; NaN outside the cochlea
        ("ohm", "f8"),
        ("pair", "i8"),
        ("sequence", "i8"),
    ],
    align=True,
)
"""Parameters, then state: the distances now, and the last sample."""


def pack(
    options: Impedance, inject: Inject, array_length_mm: float, period_s: float, seed: int, record: np.void
) -> None:
    """Fill an IMPEDANCE record.

    Raises:
        OptionError: the contacts do not fit on the array, the bounds of the series resistance are the wrong way round, or
            the contact to be shorted begins no pair.
    """
    low, high = options.series_ohm
    if low > high:
        raise OptionError(
            "backend.options.impedance.series_ohm is not an interval", value=list(options.series_ohm), bound="low, high"
        )
    if inject.short_channel_after_s is not None and inject.short_channel >= CONTACTS - options.pair_step:
        raise OptionError(
            "backend.options.inject.short_channel begins no pair", value=inject.short_channel,
            bound=f"at most {CONTACTS - options.pair_step - 1}", remedy="short another one, or set pair_step to 1",
        )  # fmt: skip
    place = options.first_contact_mm + options.pitch_mm * np.arange(CONTACTS)
    if place[-1] > array_length_mm:
        raise OptionError(
            "the last contact is not on the array", value=float(place[-1]), bound=f"at most {array_length_mm:g} mm",
            remedy="lower backend.options.impedance.first_contact_mm or pitch_mm",
        )  # fmt: skip
    for name in (
        "factor_ohm",
        "exponent",
        "far_field_ohm",
        "area_max_mm2",
        "distance_min_mm",
        "pitch_mm",
        "noise_ohm",
        "pair_step",
        "bath",
    ):
        record[name] = getattr(options, name)
    record["contact_from_tip_mm"] = place
    record["series_ohm"] = np.random.default_rng((seed, int(_STREAM))).uniform(low, high, CONTACTS) / 2
    record["period_ticks"] = max(round(options.pair_period_s / period_s), 1)
    record["stale_ticks"] = round(STALE_S / period_s)
    for name in ("silent", "open", "short"):
        after_s = inject.impedance_silent_after_s if name == "silent" else getattr(inject, f"{name}_channel_after_s")
        record[f"{name}_ticks"] = NEVER_TICKS if after_s is None else round(after_s / period_s)
    record["open_channel"], record["short_channel"] = inject.open_channel, inject.short_channel
    record["modiolar_distance_mm"] = record["ohm"] = math.nan
    record["pair"] = -1


@kernel
def begin_sweep(impedance):
    """A new session: no sample yet."""
    impedance.sequence, impedance.pair, impedance.ohm = 0, -1, math.nan


@kernel
def measure(impedance, seed, since_ticks):
    """Take the sample that is due so long after the session's first tick, if one is.

    The first is due after one period. If samples were missed because ticks were, the last of them is taken.
    """
    due = min(since_ticks, impedance.silent_ticks - 1) // impedance.period_ticks
    if due <= impedance.sequence:
        return
    impedance.sequence = due
    sample_tick = due * impedance.period_ticks
    pairs = CONTACTS - impedance.pair_step
    first = (due - 1) % pairs
    second = first + impedance.pair_step
    impedance.pair = first
    broken = sample_tick >= impedance.open_ticks and (
        first == impedance.open_channel or second == impedance.open_channel
    )
    if broken:
        impedance.ohm = OPEN_OHM
        return
    if sample_tick >= impedance.short_ticks and first == impedance.short_channel:
        value = SHORT_OHM
    else:
        value = bipolar_ohm(impedance, first, second)
    value += impedance.noise_ohm * normal_pair(seed ^ _STREAM, np.uint64(due))[0]
    impedance.ohm = OPEN_OHM if not value < OPEN_OHM else max(value, LEAST_OHM)


@kernel
def bipolar_ohm(impedance, first, second):
    """z = a A^b + c [ohm] of a pair of contacts, with its leads; NaN if one of them is in air."""
    near, far = impedance.modiolar_distance_mm[first], impedance.modiolar_distance_mm[second]
    area = impedance.area_max_mm2
    if not impedance.bath:
        if not (math.isfinite(near) and math.isfinite(far)):
            return math.nan
        mean = (max(near, impedance.distance_min_mm) + max(far, impedance.distance_min_mm)) / 2
        area = min(mean * impedance.pitch_mm, area)
    fluid = impedance.factor_ohm * area**impedance.exponent + impedance.far_field_ohm
    return fluid + impedance.series_ohm[first] + impedance.series_ohm[second]
