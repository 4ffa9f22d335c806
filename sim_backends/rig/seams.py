"""Seams that end in an emulated bench of other processes: cards in shared memory, buses and lines by local sockets and
terminals, datagrams as on the target."""

from hal.seams import PortIO, SerialLine
from hal.sockets import SerialPort, SocketSeams
from sim_backends.emulators.sensoray526 import CARD, CardPorts
from sim_backends.rig import links, memory
from sim_backends.rig.can_socket import CanSocket


def card_name(base: int) -> str:
    """Name of the record of the card at `base`."""
    return f"card-{base:x}"


class RigSeams(SocketSeams):
    """The driver's ends; `where` is the name of the bench, "" for the one called "bench"."""

    def __init__(self, where: str = "") -> None:
        self._place = where or "bench"

    def ports(self, base: int, size: int) -> PortIO:  # noqa: ARG002
        """The register file of a card whose record the bench holds: the registers answer in this process, at once."""
        return CardPorts(memory.attach(self._place, card_name(base), CARD))

    def serial(self, path: str, baud: int) -> SerialLine:
        """The terminal that stands for the port `path`."""
        return SerialPort(str(links.serial_path(self._place, path)), baud)

    def can_bus(self, interface: str, channel: str, bitrate: int) -> CanSocket:  # noqa: ARG002
        """The emulated bus `channel`, whatever interface the settings name."""
        return CanSocket(links.can_path(self._place, channel))
