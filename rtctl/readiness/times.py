"""Times counted one by one, so that a day of them takes no more room than a minute."""

from typing import Any

import numpy as np

COUNTED_NS = 1_000_000
"""Up to here every nanosecond has a counter, as in the histogram of cyclictest; what is longer is kept as it is."""
BINS_A_DECADE = 20
SHORTEST_US, LONGEST_US = 0.1, 1e6
"""Ends of the histogram that is told; what lies beyond counts in its first and last bin."""


class Times:
    """Times [ns], never negative."""

    def __init__(self) -> None:
        self._counts = np.zeros(COUNTED_NS, np.int64)
        self._longer = np.zeros(0, np.int64)

    def add(self, times_ns: np.ndarray, counts: np.ndarray | int = 1) -> None:
        """Count the times (n,), each once or as often as `counts` (n,) says."""
        times = np.maximum(np.asarray(times_ns, np.int64), 0)
        counts = np.broadcast_to(np.asarray(counts, np.int64), times.shape)
        short = times < COUNTED_NS
        np.add.at(self._counts, times[short], counts[short])
        if not short.all():
            self._longer = np.sort(np.concatenate((self._longer, np.repeat(times[~short], counts[~short]))))

    def merge(self, other: "Times") -> None:
        """Count what `other` has counted, too."""
        self._counts += other._counts
        self._longer = np.sort(np.concatenate((self._longer, other._longer)))

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self._counts.sum()) + len(self._longer)

    @property
    def longest_ns(self) -> int:
        """The longest. Raises ValueError if there is none."""
        return self.percentile_ns(100.0)

    def percentile_ns(self, percent: float) -> int:
        """The smallest time that `percent` of all times do not exceed. Raises ValueError if there are none."""
        if self.count == 0:
            raise ValueError("there are no times")
        rank = max(1, int(np.ceil(percent / 100.0 * self.count - 1e-9)))
        below = np.cumsum(self._counts)
        if rank <= below[-1]:
            return int(np.searchsorted(below, rank))
        return int(self._longer[rank - int(below[-1]) - 1])

    def longer_than(self, bound_ns: int) -> int:
        """How many are longer than the bound."""
        return int(self._counts[bound_ns + 1 :].sum()) + int((self._longer > bound_ns).sum())

    def histogram(self) -> dict[str, list[Any]]:
        """`edges_us` (k + 1,) and `counts` (k,) in steps of a twentieth of a decade, without empty ends."""
        decades = round(np.log10(LONGEST_US / SHORTEST_US))
        edges_us = SHORTEST_US * 10.0 ** (np.arange(decades * BINS_A_DECADE + 1) / BINS_A_DECADE)
        present = np.flatnonzero(self._counts)
        times_us = np.concatenate((present, self._longer)) * 1e-3
        weights = np.concatenate((self._counts[present], np.ones(len(self._longer), np.int64)))
        bins = np.clip(np.searchsorted(edges_us, times_us, side="right") - 1, 0, len(edges_us) - 2)
        counts = np.bincount(bins, weights, len(edges_us) - 1).astype(np.int64)
        used = np.flatnonzero(counts)
        if not len(used):
            return {"edges_us": [], "counts": []}
        first, last = int(used[0]), int(used[-1])
        return {
            "edges_us": [float(f"{edge:.4g}") for edge in edges_us[first : last + 2]],
            "counts": counts[first : last + 1].tolist(),
        }
