"""What every pair last read in this run: which are stale, and whether the sender repeats itself (07 section 4)."""

OPEN_OHM, SHORT_OHM = 28_500.0, 500.0
"""From and below which a reading is an open circuit or a short, the same every time, and tells nothing of a frozen sender."""
STALE_SWEEPS = 2


class PairMemory:
    """Readings of `pairs` pairs; a pair that was never heard is neither stale nor repeating."""

    def __init__(self, pairs: int, sweep_ticks: int) -> None:
        self._stale_ticks = STALE_SWEEPS * sweep_ticks
        self._ohm = [float("nan")] * pairs
        self._tick = [0] * pairs
        self._repeats = [-1] * pairs

    def hear(self, pair: int, ohm: float, tick: int) -> None:
        """A new reading of `pair`."""
        self._repeats[pair] = self._repeats[pair] + 1 if ohm == self._ohm[pair] else 0
        self._ohm[pair], self._tick[pair] = ohm, tick

    def stale(self, tick: int) -> int:
        """How many pairs were heard, but not within two sweeps."""
        return sum(self._heard(k) and not self._is_fresh(k, tick) for k in range(len(self._ohm)))

    def repeated_sweeps(self, tick: int) -> int:
        """How many sweeps in a row all fresh pairs read the same; 0 where nothing but opens and shorts is measured."""
        fresh = [k for k in range(len(self._ohm)) if self._heard(k) and self._is_fresh(k, tick)]
        if not any(SHORT_OHM <= self._ohm[k] < OPEN_OHM for k in fresh):
            return 0
        return min(self._repeats[k] for k in fresh)

    def _heard(self, pair: int) -> bool:
        return self._repeats[pair] >= 0

    def _is_fresh(self, pair: int, tick: int) -> bool:
        return tick - self._tick[pair] <= self._stale_ticks
