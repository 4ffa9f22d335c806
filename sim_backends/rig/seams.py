"""Seams that end in an emulated bench of other processes: cards in shared memory, everything else by its real sockets."""

from hal.seams import PortIO
from hal.sockets import SocketSeams
from sim_backends.emulators.sensoray526 import CARD, CardPorts
from sim_backends.rig import memory


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
