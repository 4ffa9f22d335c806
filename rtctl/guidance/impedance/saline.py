"""Bias of every pair from an array in a bath of saline (04 section 4; (VII.20), (VII.21)).

At least a couple of millimetres from any wall a pair reads its far-field value and the resistance of its leads; what is
more than the far-field value is the bias r.
"""

from dataclasses import dataclass

import numpy as np

from hal.frames import VALID
from rtctl.calibrate.errors import CalibrationError
from rtctl.settings import Impedance

LEAST_SAMPLES = 5
"""Sweeps without which a mean is none."""
LEAST_SHARE = 0.5
"""With fewer good pairs the array is broken, or not in the bath."""


@dataclass(frozen=True)
class Bath:
    """What n pairs read, all (n,).

    bias_ohm: r, 0 for a dead pair. mean_ohm, deviation_ohm: of the samples. samples: how many. dead: why a pair cannot
    guide, empty if it can.
    """

    bias_ohm: np.ndarray
    mean_ohm: np.ndarray
    deviation_ohm: np.ndarray
    samples: np.ndarray
    dead: tuple[str, ...]

    @property
    def left_out(self) -> list[int]:
        """Numbers of the dead pairs."""
        return [k for k, why in enumerate(self.dead) if why]


def samples_of(records: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pair and reading [ohm] of every sample in controller records, both (m,)."""
    fresh = np.diff(records["impedance_sequence"], prepend=-1) != 0
    known = fresh & (records["impedance_validity"] == VALID)
    return records["impedance_pair"][known].astype(int), records["impedance_ohm"][known]


def calibrate(pair: np.ndarray, ohm: np.ndarray, settings: Impedance, pairs: int, far_field_ohm: float) -> Bath:
    """The bias with which every pair reads `far_field_ohm`; dead pairs are told, not averaged.

    pair, ohm: samples (m,). pairs: how many there are. far_field_ohm: (VII.21) takes c of the power law.

    Raises:
        CalibrationError: a pair was hardly measured, or most of them are dead.
    """
    counted = np.bincount(pair[(pair >= 0) & (pair < pairs)], minlength=pairs)
    if counted.min() < LEAST_SAMPLES:
        what = f"pair {int(counted.argmin())} was hardly measured"
        raise CalibrationError(what, value=f"{int(counted.min())} samples", bound=f"at least {LEAST_SAMPLES}", remedy="leave the array in the bath for longer: a sweep takes 1.5 s")  # fmt: skip
    readings = [ohm[pair == k] for k in range(pairs)]
    dead = tuple(_why_dead(z, settings) for z in readings)
    if sum(not why for why in dead) < LEAST_SHARE * pairs:
        listed = "; ".join(f"{k} {why}" for k, why in enumerate(dead) if why)
        raise CalibrationError("most pairs are dead", value=listed, bound=f"at most {pairs - round(LEAST_SHARE * pairs)}", remedy="see that the whole array is in the saline, free of bubbles")  # fmt: skip
    mean = np.array([z.mean() for z in readings])
    bias = np.where([bool(why) for why in dead], 0.0, mean - far_field_ohm)
    return Bath(bias, mean, np.array([z.std(ddof=1) for z in readings]), counted, dead)


def _why_dead(z: np.ndarray, settings: Impedance) -> str:
    """Why a pair with these samples cannot guide, by the rules of the tick; empty if it can."""
    if not np.isfinite(z).all():
        return "reads no number"
    if (z >= settings.open_ohm).any():
        return "open"
    if (z < settings.short_ohm).any():
        return "shorted"
    return "noisy" if z.std(ddof=1) > settings.noise_limit_ohm else ""
