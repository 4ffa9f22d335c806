"""The hash that says whether a replay is the same experiment: one for every second of output fields.

The writer and the replay use the same functions, so equal bytes give equal entries and nothing else does.
"""

import hashlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from rtctl.record import INPUTS, TIMING

TICKS_PER_HASH = 1000
DIGEST_BYTES = 16
PADDING = "reserved"


def output_fields(dtype: np.dtype) -> tuple[str, ...]:
    """Names of what a replay must reproduce: neither inputs, nor timing, nor padding."""
    return tuple(n for n in dtype.names or () if n not in INPUTS and n not in TIMING and n != PADDING)


def split_seconds(rows: np.ndarray) -> Iterator[np.ndarray]:
    """Pieces of `rows`, shape (n,), that lie in one cell of the grid ``tick // 1000``, in order."""
    cells = rows["tick"] // TICKS_PER_HASH
    edges = np.flatnonzero(np.diff(cells)) + 1
    return (piece for piece in np.split(rows, edges) if len(piece))


class OutputHash:
    """Hash over the bytes of the output fields, row after row, however the rows are batched."""

    def __init__(self, dtype: np.dtype) -> None:
        self._dtype = dtype
        self._columns = _byte_columns(dtype)
        self._first: int | None = None
        self._last = self._cell = self._rows = 0
        self._hash = hashlib.blake2b(digest_size=DIGEST_BYTES)

    def add(self, rows: np.ndarray) -> dict[str, Any] | None:
        """Take rows of one second, see :func:`split_seconds`; the entry of the last second if a new one begins."""
        first = int(rows["tick"][0])
        done = self.finish() if self._first is not None and first // TICKS_PER_HASH != self._cell else None
        if self._first is None:
            self._first = first
        self._cell = first // TICKS_PER_HASH
        self._last = int(rows["tick"][-1])
        self._rows += len(rows)
        contiguous = np.ascontiguousarray(rows, self._dtype)
        self._hash.update(contiguous.view("u1").reshape(len(rows), -1)[:, self._columns].tobytes())
        return done

    def finish(self) -> dict[str, Any] | None:
        """The entry of the second under way, if it has rows, and begin anew."""
        if self._first is None:
            return None
        entry = {
            "first_tick": self._first,
            "last_tick": self._last,
            "rows": self._rows,
            "blake2b": self._hash.hexdigest(),
        }
        self._first, self._rows = None, 0
        self._hash = hashlib.blake2b(digest_size=DIGEST_BYTES)
        return entry


def hash_rows(rows: np.ndarray) -> list[dict[str, Any]]:
    """Entries of all seconds of `rows`, shape (n,), as the writer would log them."""
    running = OutputHash(rows.dtype)
    entries = [running.add(piece) for piece in split_seconds(rows)]
    return [entry for entry in (*entries, running.finish()) if entry is not None]


def check_hashes(rows: np.ndarray, logged: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The logged entries that `rows`, sorted by tick, do not reproduce; empty when all is the same to the bit.

    Every entry is judged on its own range of ticks, so seconds cut by a restart of the gateway count too.
    """
    ticks = rows["tick"]
    wrong = []
    for entry in logged:
        begin = np.searchsorted(ticks, entry["first_tick"], "left")
        end = np.searchsorted(ticks, entry["last_tick"], "right")
        if hash_rows(rows[begin:end]) != [entry]:
            wrong.append(entry)
    return wrong


def _byte_columns(dtype: np.dtype) -> np.ndarray:
    """Positions, in a row, of the bytes of the output fields."""
    spans = [(dtype.fields[n][1], dtype.fields[n][0].itemsize) for n in output_fields(dtype)] if dtype.fields else []
    return np.concatenate([np.arange(at, at + size) for at, size in spans])
