"""The devices' ends of the links between the processes of an emulated bench."""

import os
import tty
from pathlib import Path
from typing import Any

from hal.sockets import DeviceSocket
from hal.switchboard import Switchboard
from sim_backends.rig import memory
from sim_backends.rig.can_socket import CanOutlet


def can_path(place: str, channel: str) -> Path:
    """Where the emulated bus `channel` of the bench `place` listens."""
    return memory.path_of(place, f"can-{_word(channel)}")


def serial_path(place: str, port: str) -> Path:
    """The terminal that stands for the serial port `port` on the bench `place`."""
    return memory.path_of(place, f"serial-{_word(port)}")


def _word(name: str) -> str:
    return "".join(c if c.isalnum() else "-" for c in name)


class RealLinks(Switchboard):
    """Drivers are in another process: what they would get from here, they open by themselves."""

    def __init__(self, place: str) -> None:
        super().__init__()
        self._place = place
        self._outlets: list[CanOutlet] = []
        self._paths: list[Path] = []

    def plug_datagrams(self, local: str, peer: str) -> DeviceSocket:
        """The device's end: bound to the driver's `peer`."""
        return DeviceSocket(bound=peer, peer=local)

    def plug_serial(self, path: str) -> "Terminal":
        """The device's end of a pseudo-terminal, which has a name of the bench."""
        link = serial_path(self._place, path)
        terminal = Terminal(link)
        self._paths.append(link)
        return terminal

    def plug_bus(self, channel: str, bus: Any) -> None:
        """Drivers reach the emulated `bus` by a local socket."""
        path = can_path(self._place, channel)
        self._outlets.append(CanOutlet(path, bus))
        self._paths.append(path)

    def fetch(self) -> None:
        """At the begin of a tick: what drivers have sent arrives on the buses."""
        for outlet in self._outlets:
            outlet.fetch()

    def deliver(self) -> None:
        """At the end of a tick: what drives have sent leaves for their drivers."""
        for outlet in self._outlets:
            outlet.deliver()

    def remove(self) -> None:
        """Take the names away."""
        for path in self._paths:
            path.unlink(missing_ok=True)


class Terminal:
    """One end of a serial line without a line: see :class:`hal.seams.SerialLine`. `link` becomes the other end's name."""

    def __init__(self, link: Path) -> None:
        self._end, self._other_end = os.openpty()  # held open too, or nobody there would read as an error here
        tty.setraw(self._other_end)
        os.set_blocking(self._end, False)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(self._other_end))

    def receive(self, buffer: bytearray) -> int:
        """What waits, or -1."""
        try:
            return os.readv(self._end, [buffer]) or -1
        except BlockingIOError:
            return -1

    def send(self, data: bytes | bytearray) -> None:
        """To the other end; what does not fit is lost, as in a port that nobody reads."""
        try:
            os.write(self._end, data)
        except BlockingIOError:
            return

    def close(self) -> None:
        """Hang up."""
        os.close(self._end)
        os.close(self._other_end)
