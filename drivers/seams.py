"""The real connections of a target PC."""

from hal.errors import BackendError
from hal.seams import PortIO
from hal.sockets import SocketSeams


class TargetSeams(SocketSeams):
    """Port instructions, UDP sockets, serial ports and CAN interfaces of this machine."""

    def __init__(self, where: str = "") -> None:
        if where:
            raise BackendError("there is one target only, this machine", value=where, remedy='write seams = "target"')

    def ports(self, base: int, size: int) -> PortIO:
        """Through the C helper with ioperm; see :mod:`drivers.sensoray526.native`."""
        from drivers.sensoray526.native import NativePorts  # only a machine with such a card needs a compiler

        return NativePorts(base, size)
