"""Seams that end in an emulated bench of other processes: cards in shared memory, everything else by its real sockets."""

from typing import Any

from hal.seams import Datagrams, PortIO, SerialLine
from hal.sockets import SerialPort, UdpSocket, open_can
from sim_backends.emulators.sensoray526 import CARD, CardPorts
from sim_backends.rig import memory


def card_name(base: int) -> str:
    """Name of the record of the card at `base`."""
    return f"card-{base:x}"


class RigSeams:
    """The driver's ends; `where` is the name of the bench, "" for the one called "bench"."""

    def __init__(self, where: str = "") -> None:
        self._place = where or "bench"

    def ports(self, base: int, size: int) -> PortIO:  # noqa: ARG002
        """The register file of a card whose record the bench holds: the registers answer in this process, at once."""
        return CardPorts(memory.attach(self._place, card_name(base), CARD))

    def datagrams(self, local: str, peer: str) -> Datagrams:
        """A real socket; an emulator in a process of its own answers."""
        return UdpSocket(local, peer)

    def serial(self, path: str, baud: int) -> SerialLine:
        """A real line: the path of an emulator's pty."""
        return SerialPort(path, baud)

    def can_bus(self, interface: str, channel: str, bitrate: int) -> Any:
        """A real interface of python-can."""
        return open_can(interface, channel, bitrate)
