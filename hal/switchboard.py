"""Seams whose other ends are emulators in the same process: what lockstep and tests run on. No time passes in it."""

from collections import deque
from typing import Any

import numpy as np

from hal.errors import BackendError
from hal.seams import OPERATION, TIMED_OUT, Datagrams, Kind, PortIO, SerialLine

QUEUE = 1000


class Switchboard:
    """Emulators plug in, drivers get the other end; what nobody plugged in is as silent as an open cable."""

    def __init__(self) -> None:
        self._ports: dict[int, PortIO] = {}
        self._pipes: dict[tuple[str, str], tuple[End, End]] = {}
        self._buses: dict[str, Any] = {}

    def plug_ports(self, base: int, ports: PortIO) -> None:
        """A card answers at `base` from now on."""
        self._ports[base] = ports

    def plug_bus(self, channel: str, bus: Any) -> None:
        """Drivers that ask for the CAN `channel` get this ``can.BusABC``."""
        self._buses[channel] = bus

    def plug_datagrams(self, local: str, peer: str) -> Datagrams:
        """The device's end of what a driver opens as (local, peer)."""
        return self._pipe(local, peer)[1]

    def plug_serial(self, path: str) -> SerialLine:
        """The device's end of a serial line."""
        return self._pipe(path, "serial", LineEnd)[1]

    def ports(self, base: int, size: int) -> PortIO:  # noqa: ARG002
        return self._ports.get(base, NoCard())

    def datagrams(self, local: str, peer: str) -> Datagrams:
        return self._pipe(local, peer)[0]

    def serial(self, path: str, baud: int) -> SerialLine:  # noqa: ARG002
        return self._pipe(path, "serial", LineEnd)[0]

    def can_bus(self, interface: str, channel: str, bitrate: int) -> Any:  # noqa: ARG002
        if channel not in self._buses:
            raise BackendError("no such CAN bus on this bench", value=channel, bound=" | ".join(self._buses) or "none")
        return self._buses[channel]

    def _pipe(self, local: str, peer: str, kind: "type[End] | None" = None) -> "tuple[End, End]":
        if (local, peer) not in self._pipes:
            there, back = deque[bytes](maxlen=QUEUE), deque[bytes](maxlen=QUEUE)
            make = kind or End
            self._pipes[local, peer] = make(back, there), make(there, back)
        return self._pipes[local, peer]


class End:
    """One end of a connection in memory that keeps the bounds of datagrams."""

    def __init__(self, coming: "deque[bytes]", going: "deque[bytes]") -> None:
        self._coming, self._going = coming, going
        self.foreign = 0

    def receive(self, buffer: bytearray) -> int:
        """See :class:`hal.seams.Datagrams`."""
        if not self._coming:
            return -1
        data = self._coming.popleft()
        n = min(len(data), len(buffer))
        buffer[:n] = data[:n]
        return len(data)

    def send(self, data: bytes | bytearray) -> None:
        """To the other end."""
        self._going.append(bytes(data))

    def close(self) -> None:
        """What had not been received is lost."""
        self._coming.clear()


class LineEnd(End):
    """One end of a serial line: what does not fit into the buffer comes with the next receive."""

    def receive(self, buffer: bytearray) -> int:
        """See :class:`hal.seams.SerialLine`."""
        if not self._coming:
            return -1
        data = self._coming.popleft()
        n = min(len(data), len(buffer))
        buffer[:n] = data[:n]
        if n < len(data):
            self._coming.appendleft(data[n:])
        return n


class NoCard:
    """An I/O range where nothing is plugged in: reads float high."""

    def execute(self, operations: np.ndarray) -> int:
        if operations.dtype != OPERATION:
            raise TypeError("operations must be of hal.seams.OPERATION")
        operations["result"][operations["kind"] == Kind.READ] = 0xFFFF
        polls = operations["kind"] == Kind.POLL
        met = 0xFFFF & operations["mask"] == operations["value"]
        operations["result"][polls] = np.where(met[polls], 0xFFFF, TIMED_OUT)
        return int((polls & ~met).sum())

    def close(self) -> None:
        pass
