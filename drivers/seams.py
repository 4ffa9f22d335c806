"""The real connections of a target PC."""

from typing import Any

from hal.errors import BackendError
from hal.seams import Datagrams, PortIO, SerialLine
from hal.sockets import SerialPort, UdpSocket, open_can


class TargetSeams:
    """Port instructions, UDP sockets, serial ports and CAN interfaces of this machine."""

    def __init__(self, where: str = "") -> None:
        if where:
            raise BackendError("there is one target only, this machine", value=where, remedy='write seams = "target"')

    def ports(self, base: int, size: int) -> PortIO:
        """Through the C helper with ioperm; see :mod:`drivers.sensoray526.native`."""
        from drivers.sensoray526.native import NativePorts  # only a machine with such a card needs a compiler

        return NativePorts(base, size)

    def datagrams(self, local: str, peer: str) -> Datagrams:
        """A non-blocking socket."""
        return UdpSocket(local, peer)

    def serial(self, path: str, baud: int) -> SerialLine:
        """Through pyserial, non-blocking."""
        return SerialPort(path, baud)

    def can_bus(self, interface: str, channel: str, bitrate: int) -> Any:
        """Through python-can."""
        return open_can(interface, channel, bitrate)
