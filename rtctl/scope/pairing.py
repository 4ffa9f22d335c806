"""Truths beside the records of the same ticks: two rings, read one after the other, are never read equally far."""

import numpy as np

from rtctl.scope.probe import Rows

LONGEST = 16384
"""Rows that wait for their counterparts; more than both rings are ever apart, unless one of them has ended."""


class Pairing:
    """Joins two streams by tick. A tick of which either row was lost is lost: the capture tells it as a gap."""

    def __init__(self) -> None:
        self._records: np.ndarray | None = None
        self._truths: np.ndarray | None = None

    def pair(self, records: np.ndarray, truths: np.ndarray) -> Rows:
        """The ticks both streams are through with; takes the next rows of each, none of them for as long as they like."""
        self._records = _appended(self._records, records)
        self._truths = _appended(self._truths, truths)
        if not len(self._records) or not len(self._truths):
            return Rows(self._records[:0], self._truths[:0])
        paired = join(self._records, self._truths)
        through = min(self._records["tick"][-1], self._truths["tick"][-1])
        self._records = self._records[self._records["tick"] > through]
        self._truths = self._truths[self._truths["tick"] > through]
        return paired


def join(records: np.ndarray, truths: np.ndarray) -> Rows:
    """The rows of the ticks that both have, in order."""
    _, i, j = np.intersect1d(records["tick"], truths["tick"], assume_unique=True, return_indices=True)
    return Rows(records[i], truths[j])


def _appended(waiting: np.ndarray | None, new: np.ndarray) -> np.ndarray:
    if waiting is None or not len(waiting):
        return new.copy()
    return waiting if not len(new) else np.concatenate([waiting, new])[-LONGEST:]
