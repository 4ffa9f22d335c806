"""The state of the bench as bytes: everything in its record, and the layout they belong to."""

import hashlib

import numpy as np

from hal.errors import BackendError
from sim_backends.plant.state import DEVICE

LAYOUT = hashlib.sha256(str(DEVICE.descr).encode()).digest()[:16]
"""Changes with any field of the record: bytes of another revision mean something else."""


def to_bytes(device: np.ndarray) -> bytes:
    """Record (1,) of dtype DEVICE as bytes."""
    return LAYOUT + device.tobytes()


def from_bytes(data: bytes) -> np.ndarray:
    """The record (1,) again.

    Raises:
        BackendError: not the state of a bench, or that of one with other fields.
    """
    if len(data) != len(LAYOUT) + DEVICE.itemsize or data[: len(LAYOUT)] != LAYOUT:
        raise BackendError(
            "this is not a state of the simulated bench of this revision",
            value=f"{len(data)} bytes",
            bound=f"{len(LAYOUT) + DEVICE.itemsize} bytes, layout {LAYOUT.hex()}",
            remedy="reload it with the revision that wrote it",
        )
    return np.frombuffer(data, DEVICE, offset=len(LAYOUT)).copy()
