"""The ring of records: one writer that never waits, any number of readers that know what they missed.

A ring is an int64 array, shape (1 + capacity, 1 + words per record). Word (0, 0) counts the records
committed. Record k lives in row 1 + k % capacity, behind its sequence word, which is

    2 k + 1   while record k is being written,
    2 k + 2   once it is complete.

A reader takes the sequence word, copies, and takes it again: unless it is 2 k + 2 both times, the writer came
by and the copy is thrown away. The reader loads every word atomically. With plain loads and fences the compiler
may read a word again after the check, or merge the two looks at the sequence into one, and torn records get through.

Numbers never repeat, so a writer or a reader that died anywhere is replaced by one that just goes on.
"""

from typing import Any

import numpy as np

from hal.kernel import kernel
from rtctl.exchange.atomics import WORD, fence_release, load_acquire, store_release, words_of


def ring_shape(dtype: np.dtype, capacity: int) -> tuple[int, int]:
    """Shape of the int64 array that is a ring of `capacity` records; zeros are an empty ring."""
    return 1 + capacity, 1 + dtype.itemsize // WORD.itemsize


@kernel
def committed(ring):
    """How many records have been committed since the ring was made."""
    return load_acquire(ring, (0, 0))


@kernel
def commit(ring, record):
    """Append `record`, over the oldest one when the ring is full. One writer only.

    Raises:
        ValueError: the record is not as long as a row.
    """
    words = words_of(record)
    if words.shape[0] != ring.shape[1] - 1:
        raise ValueError("the record is not as long as a row of the ring")
    number = load_acquire(ring, (0, 0))
    row = 1 + number % (ring.shape[0] - 1)
    store_release(ring, (row, 0), 2 * number + 1)
    fence_release()
    for i in range(words.shape[0]):
        ring[row, 1 + i] = words[i]
    store_release(ring, (row, 0), 2 * number + 2)
    store_release(ring, (0, 0), number + 1)


@kernel
def copy_records(ring, position, rows):
    """Copy complete records, oldest first, from record number `position` on into `rows` (n, words).

    Returns (copied, position, lost): the number to continue at, and how many of the records before it were
    overwritten before or while they were read. Always `copied + lost` = the advance of `position`. Takes at
    most one round of the ring, however fast the writer is.

    Raises:
        ValueError: `rows` are not as long as those of the ring.
    """
    if rows.shape[1] != ring.shape[1] - 1:
        raise ValueError("the rows are not as long as those of the ring")
    capacity = ring.shape[0] - 1
    head = load_acquire(ring, (0, 0))
    oldest = max(position, head - capacity)
    copied, lost, position = 0, oldest - position, oldest
    while position < head and copied < rows.shape[0]:
        if _copy_record(ring, position, rows[copied]):
            copied += 1
        else:
            lost += 1
        position += 1
    return copied, position, lost


@kernel
def _copy_record(ring, number, words):
    row = 1 + number % (ring.shape[0] - 1)
    complete = 2 * number + 2
    if load_acquire(ring, (row, 0)) != complete:
        return False
    for i in range(words.shape[0]):
        words[i] = load_acquire(ring, (row, 1 + i))
    return load_acquire(ring, (row, 0)) == complete


class RingReader:
    """A reader with its own buffer: each :meth:`read` returns what is new, and `lost` counts what was missed."""

    def __init__(self, ring: np.ndarray, dtype: np.dtype, *, limit: int = 256, position: int = 0) -> None:
        """Read records of `dtype`, at most `limit` at once, beginning with record number `position`."""
        self.position = position
        self.lost = 0
        self._ring = ring
        self._records = np.zeros(limit, dtype)
        self._words: np.ndarray[Any, Any] = self._records.view(WORD).reshape(limit, -1)

    def read(self) -> np.ndarray:
        """The next records, shape (0 .. limit,), valid until the next call."""
        copied, self.position, lost = copy_records(self._ring, self.position, self._words)
        self.lost += lost
        return self._records[:copied]
