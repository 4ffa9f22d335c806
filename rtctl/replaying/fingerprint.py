"""One byte that stands for the value of a signal in a tick.

Outputs follow from inputs, so a log that is only to be replayed need not hold them: a byte each tells whether a value came
out again, and in which tick it did not. A wrong value goes unnoticed in one tick of 256; what is wrong for longer is found.
"""

import numpy as np

PREFIX = "fingerprint_of_"
MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)
"""2**64 over the golden ratio, odd: every bit of a word reaches the upper ones."""


def fingerprints(values: np.ndarray) -> np.ndarray:
    """Fingerprints (n,) of dtype u1, of the bytes of `values` (n, ...); a value has at most 8 bytes a number."""
    rows = np.ascontiguousarray(values).view("u1").reshape(len(values), -1)
    padded = np.zeros((len(rows), -(-rows.shape[1] // 8) * 8), "u1")
    padded[:, : rows.shape[1]] = rows
    mixed = np.zeros(len(rows), "u8")
    for word in padded.view("<u8").T:
        mixed = (mixed ^ word) * MULTIPLIER
        mixed ^= mixed >> np.uint64(32)
    return (mixed * MULTIPLIER >> np.uint64(56)).astype("u1")
