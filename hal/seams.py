"""The narrow seams between a driver and the electricity: port operations, datagrams, CAN frames, serial bytes.

A driver asks a :class:`Seams` for its connection and never opens one itself, so the same driver runs on a target PC, on
the bench with emulated devices, and in lockstep. Nothing here waits, and nothing may raise once a connection is open:
what is wrong is told by what comes back.
"""

import enum
from importlib.metadata import entry_points
from typing import Any, Protocol

import numpy as np

from hal.errors import BackendError

GROUP = "rtctl.seams"

OPERATION = np.dtype(
    [("kind", "i4"), ("port", "i4"), ("value", "i4"), ("mask", "i4"), ("limit", "i4"), ("result", "i4")], align=True
)
"""One port operation.

port: absolute I/O address, even. value: the 16-bit word to write, or for POLL the masked word to wait for. mask, limit: of
POLL, which reads at most `limit` times. result: the word read, 0 .. 65535, or TIMED_OUT; untouched by WRITE.
"""
TIMED_OUT = -1


class Kind(enum.IntEnum):
    """What a port operation does, with one 16-bit access (POLL with up to `limit`)."""

    READ = 0
    WRITE = 1
    POLL = 2


class PortIO(Protocol):
    """A card's registers, in batches: one call carries all that belongs together."""

    def execute(self, operations: np.ndarray) -> int:
        """Carry out `operations` (n,) of OPERATION in order, each exactly once. Returns how many POLLs timed out."""

    def close(self) -> None:
        """Release the ports. May be called twice."""


class Datagrams(Protocol):
    """A UDP socket that never waits and hears one peer only."""

    foreign: int
    """datagrams dropped because somebody else sent them"""

    def receive(self, buffer: bytearray) -> int:
        """Put the oldest waiting datagram into `buffer`; its length (also if the buffer is shorter), or -1 for none."""

    def send(self, data: bytes | bytearray) -> None:
        """Send to the peer; what cannot be sent is lost, as in any network."""

    def close(self) -> None:
        """Release the socket. May be called twice."""


class SerialLine(Protocol):
    """A serial port that never waits."""

    def receive(self, buffer: bytearray) -> int:
        """Put waiting bytes into `buffer`, as many as fit; how many, or -1 for none."""

    def send(self, data: bytes | bytearray) -> None:
        """Queue bytes for sending."""

    def close(self) -> None:
        """Release the port. May be called twice."""


class Seams(Protocol):
    """Opens connections. Every method raises BackendError with what to do when it cannot."""

    def ports(self, base: int, size: int) -> PortIO:
        """I/O addresses base .. base + size - 1 of one card."""

    def datagrams(self, local: str, peer: str) -> Datagrams:
        """UDP between two "address:port"; an empty `local` lets the system choose."""

    def serial(self, path: str, baud: int) -> SerialLine:
        """8N1 at `baud`."""

    def can_bus(self, interface: str, channel: str, bitrate: int) -> Any:
        """A ``can.BusABC`` of python-can."""


def load(choice: str) -> Seams:
    """Make the seams of a setting: "target" for the real ones, or "rig:NAME" with a place. Raises BackendError."""
    name, _, where = choice.partition(":")
    found = {e.name: e for e in entry_points(group=GROUP)}
    if name not in found:
        raise BackendError(
            "no such seams", value=choice, bound=" | ".join(sorted(found)), remedy="set [backend.options] seams"
        )
    return found[name].load()(where)
