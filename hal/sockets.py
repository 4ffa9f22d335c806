"""Sockets and lines of this machine, none of which ever waits: the seams' real ends."""

import socket
from typing import Any

from hal.errors import BackendError
from hal.seams import Datagrams, SerialLine


def open_can(interface: str, channel: str, bitrate: int) -> Any:
    """A ``can.BusABC``; the bit rate of a socketcan interface is set by `ip link`. Raises BackendError."""
    import can  # only where there is a bus

    try:
        return can.Bus(interface=interface, channel=channel, bitrate=bitrate)
    except (can.CanError, OSError, ValueError) as error:
        raise BackendError("the CAN bus cannot be opened", value=f"{interface} {channel}", remedy=f"is it up? see docs/how-to/wire-epos-drives.md ({error})") from None  # fmt: skip


def address_of(text: str) -> tuple[str, int]:
    """Host and port of "host:port". Raises BackendError."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise BackendError("no such address", value=text, bound="host:port", remedy="for instance 192.168.1.1:49152")
    return host, int(port)


class _Socket:
    """What both ends of UDP have in common; a peer of None is nobody."""

    def __init__(self) -> None:
        self.foreign = 0
        self._peer: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def send(self, data: bytes | bytearray) -> None:
        """To the peer, or nowhere."""
        if self._peer is None:
            return
        try:
            self._socket.sendto(data, self._peer)
        except (BlockingIOError, OSError):
            return

    def close(self) -> None:
        """Release the socket."""
        self._socket.close()


class UdpSocket(_Socket):
    """See :class:`hal.seams.Datagrams`. Not connected: a refused packet of a device that is still off is no error."""

    def __init__(self, local: str, peer: str) -> None:
        super().__init__()
        host, port = address_of(peer)
        try:
            self._peer = (socket.gethostbyname(host), port)
            self._socket.bind(address_of(local) if local else ("", 0))
        except OSError as error:
            self._socket.close()
            raise BackendError("no datagrams can be exchanged", value=f"{local or 'any'} with {peer}", remedy=f"check addresses and what else uses the port ({error.strerror})") from None  # fmt: skip

    def receive(self, buffer: bytearray) -> int:
        """The oldest datagram of the peer; others are dropped and counted."""
        while True:
            try:
                data, sender = self._socket.recvfrom(2048)
            except (BlockingIOError, OSError):
                return -1
            if sender == self._peer:
                n = min(len(data), len(buffer))
                buffer[:n] = data[:n]
                return len(data)
            self.foreign += 1


class SerialPort:
    """See :class:`hal.seams.SerialLine`."""

    def __init__(self, path: str, baud: int, write_timeout_s: float = 0.0) -> None:
        import serial  # only where there is a line

        try:
            self._port = serial.Serial(path, baud, timeout=0, write_timeout=write_timeout_s)
        except (serial.SerialException, OSError, ValueError) as error:
            raise BackendError("the serial port cannot be opened", value=path, remedy=f"check its name and your rights, on Debian the group dialout ({error})") from None  # fmt: skip
        self._errors = (serial.SerialException, OSError)

    def receive(self, buffer: bytearray) -> int:
        """What waits, or -1."""
        try:
            return self._port.readinto(buffer) or -1
        except self._errors:
            return -1

    def send(self, data: bytes | bytearray) -> None:
        """Queue bytes."""
        try:
            self._port.write(data)
        except self._errors:
            return

    def close(self) -> None:
        """Release the port."""
        self._port.close()


class DeviceSocket(_Socket):
    """The other end of a :class:`UdpSocket`, for emulators in processes of their own: answers whoever asked last.

    bound: "address:port" the driver sends to. peer: where to send without having been asked, or "".
    """

    def __init__(self, bound: str, peer: str) -> None:
        super().__init__()
        self._peer = address_of(peer) if peer else None
        try:
            self._socket.bind(address_of(bound))
        except OSError as error:
            self._socket.close()
            raise BackendError("an emulated device cannot have its address", value=bound, remedy=f"free it, or change the settings ({error.strerror})") from None  # fmt: skip

    def receive(self, buffer: bytearray) -> int:
        """See :class:`hal.seams.Datagrams`."""
        try:
            data, self._peer = self._socket.recvfrom(2048)
        except (BlockingIOError, OSError):
            return -1
        n = min(len(data), len(buffer))
        buffer[:n] = data[:n]
        return len(data)


class SocketSeams:
    """The seams that end in this machine whoever answers: UDP, serial lines, CAN."""

    def datagrams(self, local: str, peer: str) -> Datagrams:
        """A non-blocking socket."""
        return UdpSocket(local, peer)

    def serial(self, path: str, baud: int) -> SerialLine:
        """Through pyserial, non-blocking."""
        return SerialPort(path, baud)

    def can_bus(self, interface: str, channel: str, bitrate: int) -> Any:
        """Through python-can."""
        return open_can(interface, channel, bitrate)
