"""The mailbox for commands, and the staging slots for what is too big for a command.

The mailbox is a queue with one producer (the gateway) and one consumer (the tick): an int64 array, shape
(1 + slots, words per command). Row 0 holds the counts of commands posted and taken, a cache line apart;
command k lives in row 1 + k % slots. Each count has one writer, and it moves only after the row was written or read.

Staging slots are an int64 array, shape (slots, 2 + words per payload): a sequence word (0 while empty, odd
while the payload changes), the number of the payload, the payload. A command names slot and number; by the time
the tick looks, the slot may hold something newer, so the tick takes the payload only if the number still fits.
"""

import numpy as np

from hal.kernel import kernel
from rtctl.commands import COMMAND
from rtctl.exchange.atomics import WORD, fence_release, load_acquire, store_release, words_of

MAILBOX_SHAPE = (1 + 64, COMMAND.itemsize // WORD.itemsize)
STAGING_SLOTS = 4
POSTED, TAKEN = 0, 8  # columns of row 0


def staging_shape(dtype: np.dtype) -> tuple[int, int]:
    """Shape of the int64 array that stages payloads of `dtype`; zeros are empty slots."""
    return STAGING_SLOTS, 2 + dtype.itemsize // WORD.itemsize


@kernel
def post(mailbox, command):
    """Queue a COMMAND record for the tick. False, and nothing queued, when the mailbox is full."""
    posted = load_acquire(mailbox, (0, POSTED))
    slots = mailbox.shape[0] - 1
    if posted - load_acquire(mailbox, (0, TAKEN)) >= slots:
        return False
    row = mailbox[1 + posted % slots]
    words = words_of(command)
    for i in range(row.shape[0]):
        row[i] = words[i]
    store_release(mailbox, (0, POSTED), posted + 1)
    return True


@kernel
def is_empty(mailbox):
    """No command waits."""
    return load_acquire(mailbox, (0, TAKEN)) == load_acquire(mailbox, (0, POSTED))


@kernel
def forget(command):
    """Clear a COMMAND record: a command is for one tick."""
    words = words_of(command)
    for i in range(words.shape[0]):
        words[i] = 0


@kernel
def take(mailbox, command):
    """Move the oldest command into a COMMAND record and return 1; return 0 and clear the record when there is none."""
    taken = load_acquire(mailbox, (0, TAKEN))
    if taken == load_acquire(mailbox, (0, POSTED)):
        forget(command)
        return 0
    words = words_of(command)
    row = mailbox[1 + taken % (mailbox.shape[0] - 1)]
    for i in range(row.shape[0]):
        words[i] = row[i]
    store_release(mailbox, (0, TAKEN), taken + 1)
    return 1


@kernel
def stage(slots, number, payload):
    """Put `payload` with its `number` (not negative) into the slot for it, and return the slot. One writer only.

    Payloads take turns, so the last four stay where they are.

    Raises:
        ValueError: the payload is not as long as a slot.
    """
    words = words_of(payload)
    if words.shape[0] != slots.shape[1] - 2:
        raise ValueError("the payload is not as long as a staging slot")
    slot = number % slots.shape[0]
    sequence = load_acquire(slots, (slot, 0))
    changing = sequence + 1 + (sequence & 1)  # odd, and new also after a writer that died half-way
    store_release(slots, (slot, 0), changing)
    fence_release()
    slots[slot, 1] = number
    for i in range(words.shape[0]):
        slots[slot, 2 + i] = words[i]
    store_release(slots, (slot, 0), changing + 1)
    return slot


@kernel
def fetch(slots, slot, number, payload):
    """Copy payload `number` out of `slot` and return True; False if the slot does not hold it, whole, any more.

    After False `payload` may hold anything: fetch into a spare record, never into the one in force.

    Raises:
        ValueError: the payload is not as long as a slot.
    """
    words = words_of(payload)
    if words.shape[0] != slots.shape[1] - 2:
        raise ValueError("the payload is not as long as a staging slot")
    if slot < 0 or slot >= slots.shape[0]:
        return False
    sequence = load_acquire(slots, (slot, 0))
    if sequence == 0 or sequence & 1 or load_acquire(slots, (slot, 1)) != number:
        return False
    for i in range(words.shape[0]):
        words[i] = load_acquire(slots, (slot, 2 + i))
    return load_acquire(slots, (slot, 0)) == sequence
