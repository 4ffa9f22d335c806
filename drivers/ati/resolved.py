"""Sensors whose own electronics make a wrench of their gauges and send it as counts (07 sections 3.4, 3.5)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.ati.gauges import HIGH_PERCENT, RATED_PERCENT
from drivers.ati.mounting import Mounting
from hal.device import Readings
from hal.errors import OptionError
from hal.options import option
from hal.tally import Tally
from hal.troubles import Trouble

FORCE_N = {"N": 1.0, "lbf": 4.44822161526}
TORQUE_NMM = {"N-mm": 1.0, "N-m": 1000.0, "lbf-in": 112.984829028}


@dataclass(frozen=True, kw_only=True)
class Resolved(Mounting):
    """What the sensor's own pages say of its numbers; there is no default that would fit another sensor."""

    counts_per_force: float = option(low=1e-3, high=1e9, doc="counts for one force_unit")
    counts_per_torque: float = option(low=1e-3, high=1e9, doc="counts for one torque_unit")
    force_unit: str = option(choices=tuple(FORCE_N), doc="unit the sensor is set to")
    torque_unit: str = option(choices=tuple(TORQUE_NMM), doc="unit the sensor is set to")
    rated_n_nmm: tuple[float, ...] = option(
        (), shape=(-1,), low=1e-3, high=1e7, doc="rated loads Fx .. Tz [N, N mm]; without them overload is not watched"
    )

    def check(self, where: str) -> None:
        """What a single bound cannot say. Raises OptionError."""
        if len(self.rated_n_nmm) not in (0, 6):
            raise OptionError(f"{where}.rated_n_nmm must be a list of 6", value=self.rated_n_nmm, remedy="Fx .. Tz, or leave it out")  # fmt: skip


class Scale:
    """Turns counts into the wrench in {F}, and into the load.

    Attributes:
        wrench (6,): in {F} [N, N mm]. load_percent: of what the sensor is rated for, 0 if nobody said.
    """

    def __init__(self, options: Resolved) -> None:
        force = FORCE_N[options.force_unit] / options.counts_per_force
        torque = TORQUE_NMM[options.torque_unit] / options.counts_per_torque
        factors = np.array([force] * 3 + [torque] * 3)
        rated = options.rated_n_nmm or (np.inf,) * 6
        self._to_both = np.vstack([options.into_f * factors, np.diag(100.0 * factors / rated)])
        self._counts, self._both = np.zeros(6), np.full(12, np.nan)
        self.wrench, self._percent = self._both[:6], self._both[6:]
        self.load_percent = 0.0

    def take(self, counts: Sequence[int]) -> None:
        """Six counts of a new record."""
        self._counts[:] = counts
        np.dot(self._to_both, self._counts, out=self._both)
        self.load_percent = max(map(abs, self._percent.tolist()))

    def report_load(self, tick: int, readings: Readings, tally: Tally) -> None:
        """Report a load that is high, or more than the sensor is made for."""
        if self.load_percent >= RATED_PERCENT:
            tally.report(tick, readings, Trouble.LOAD_OVER_RATED, self.load_percent)
        elif self.load_percent >= HIGH_PERCENT:
            tally.report(tick, readings, Trouble.LOAD_HIGH, self.load_percent)
