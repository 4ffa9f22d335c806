"""A CAN bus between two processes of one machine: frames of the kernel's own layout over a local socket.

It stands for socketcan where the kernel has none, so that drivers of drives run in real time on any desk. Bits and their
time are charged by the emulator's :class:`sim_backends.emulators.epos_can.LockstepBus`, behind the device's end.
"""

import contextlib
import select
import socket
import struct
from pathlib import Path
from typing import Any

import can

from hal.errors import BackendError

FRAME = struct.Struct("=IB3x8s")
ERROR_FLAG, IDENTIFIERS = 0x20000000, 0x1FFFFFFF


class CanSocket(can.BusABC):
    """The driver's end. Raises BackendError where no bench listens at `path`."""

    def __init__(self, path: Path) -> None:
        super().__init__(channel=str(path))
        self.channel_info = f"emulated bus {path.name}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._socket.connect(str(path))
        except OSError as error:
            self._socket.close()
            self._is_shutdown = True
            raise BackendError("no such CAN bus on the emulated bench", value=path.name, remedy=f"start it first: rtctl bench rig CONFIG ({error.strerror})") from None  # fmt: skip
        self._socket.setblocking(False)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        """Queue a frame. Raises CanOperationError if there is no room, or nobody at the other end."""
        try:
            self._socket.send(FRAME.pack(msg.arbitration_id, len(msg.data), bytes(msg.data)))
        except OSError as error:
            raise can.CanOperationError(str(error.strerror)) from None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if timeout != 0.0 and not select.select([self._socket], [], [], timeout)[0]:
            return None, False
        try:
            frame = self._socket.recv(FRAME.size)
        except OSError:
            return None, False
        return (unpacked(frame) if len(frame) == FRAME.size else None), False

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._socket.close()


class CanOutlet:
    """The device's end: carries frames between whoever has connected to `path` last and the emulated bus."""

    def __init__(self, path: Path, bus: Any) -> None:
        self._bus = bus
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        path.unlink(missing_ok=True)
        self._listener.bind(str(path))
        self._listener.listen(1)
        self._listener.setblocking(False)
        self._peer: socket.socket | None = None

    def fetch(self) -> None:
        """Everything the driver sent goes on the bus. A frame that the bus or the drives refuse is lost, as on a wire."""
        with contextlib.suppress(BlockingIOError):
            peer, _ = self._listener.accept()
            peer.setblocking(False)
            self._hang_up()
            self._peer = peer
        while self._peer is not None:
            try:
                frame = self._peer.recv(FRAME.size)
            except BlockingIOError:
                return
            except OSError:
                frame = b""
            if len(frame) != FRAME.size:
                self._hang_up()
                return
            with contextlib.suppress(can.CanError, ValueError):
                self._bus.send(unpacked(frame))

    def deliver(self) -> None:
        """Everything the drives sent goes to the driver; what it does not fetch in time is lost."""
        while (message := self._bus.recv(0.0)) is not None:
            if self._peer is not None:
                flag = ERROR_FLAG if message.is_error_frame else 0
                with contextlib.suppress(OSError):
                    self._peer.send(FRAME.pack(message.arbitration_id | flag, len(message.data), bytes(message.data)))

    def _hang_up(self) -> None:
        if self._peer is not None:
            self._peer.close()
            self._peer = None


def unpacked(frame: bytes) -> can.Message:
    """The message of a frame."""
    identifier, size, data = FRAME.unpack(frame)
    return can.Message(
        arbitration_id=identifier & IDENTIFIERS,
        is_extended_id=False,
        is_error_frame=bool(identifier & ERROR_FLAG),
        data=data[: min(size, 8)],
    )
