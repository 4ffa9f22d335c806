"""One sample after the other: what every pair last read, how old that is, and whether it can be believed (04 section 4, 07 section 4)."""

import math

from hal.frames import VALID
from hal.kernel import kernel

NOISE_BLEND = 0.25
"""Share of a new sample in the estimate of a pair's noise; it forgets over four sweeps."""


@kernel
def take(law, store, record):
    """Keep the sample of this tick if there is a new one.

    An open circuit, a short, or what is no number leaves its pair without a value until the next good sample.
    """
    if record.impedance_validity != VALID or record.impedance_sequence == store.sequence:
        return
    store.sequence = record.impedance_sequence
    k = record.impedance_pair
    if k < 0 or k >= law.pairs:
        return
    raw = record.impedance_ohm
    store.sampled[k] = 1
    store.sample_tick[k] = record.tick - record.impedance_age_ticks
    if not (law.short_ohm <= raw < law.open_ohm):  # NaN is neither
        store.z_ohm[k] = store.change_ohm[k] = math.nan
        return
    z = raw - law.bias_ohm[k]
    change = z - store.z_ohm[k]
    _judge_noise(store, k, change)
    store.z_ohm[k], store.change_ohm[k] = z, change


@kernel
def _judge_noise(store, k, change):
    """Estimate the variance of pair k from two changes in a row, which noise makes opposite: E[-dz dz'] = sigma^2.

    An approach of the wall, however fast, moves z one way, and counts for nothing.
    """
    product = -change * store.change_ohm[k]
    if math.isfinite(product):
        store.noise_ohm2[k] = max(store.noise_ohm2[k] + NOISE_BLEND * (product - store.noise_ohm2[k]), 0.0)


@kernel
def is_silent(law, record):
    """True if the link as a whole gives no samples any more."""
    return record.impedance_validity != VALID or record.impedance_age_ticks > law.link_age_ticks


@kernel
def is_usable(law, store, k, depth_mm, tick):
    """True if pair k may guide: inside the cochlea at this depth, fresh, neither open nor shorted, calm, not left out."""
    if law.left_out[k] or not math.isfinite(store.z_ohm[k]):
        return False
    is_outside = law.length_mm - law.place_mm[k + law.pair_step] >= depth_mm
    if is_outside or tick - store.sample_tick[k] > law.pair_age_ticks:
        return False
    return store.noise_ohm2[k] <= law.noise_limit_ohm * law.noise_limit_ohm


@kernel
def usable_pairs(law, store, depth_mm, tick):
    """Pairs that may guide, as bits, and how many they are."""
    bits, count = 0, 0
    for k in range(law.pairs):
        if is_usable(law, store, k, depth_mm, tick):
            bits |= 1 << k
            count += 1
    return bits, count


@kernel
def is_swept(law, store, since_tick):
    """True if every pair that is not left out has been measured, well or not, after `since_tick`."""
    for k in range(law.pairs):
        if not law.left_out[k] and not (store.sampled[k] and store.sample_tick[k] > since_tick):
            return False
    return True


@kernel
def forget_samples(store):
    """Nothing has been measured."""
    for k in range(store.z_ohm.shape[0]):
        store.sampled[k] = store.sample_tick[k] = 0
        store.z_ohm[k] = store.change_ohm[k] = math.nan
        store.noise_ohm2[k] = 0.0
