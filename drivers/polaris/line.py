"""The serial line to a tracker: what the loop's seam gives, and break and baud rate beside."""

from typing import Protocol

from hal.seams import SerialLine
from hal.sockets import SerialPort


class TrackerLine(SerialLine, Protocol):
    """A :class:`hal.seams.SerialLine` that a tracker can be reset through."""

    def set_baud(self, baud: int) -> None:
        """Go on at another rate, 8N1."""

    def send_break(self) -> None:
        """Hold the line low: the tracker starts anew, at 9600."""


class TrackerPort(SerialPort):
    """Through pyserial. Raises BackendError if the port cannot be opened."""

    def __init__(self, path: str) -> None:
        super().__init__(path, 9600, write_timeout_s=1.0)

    def set_baud(self, baud: int) -> None:
        """Go on at another rate."""
        self._port.baudrate = baud

    def send_break(self) -> None:
        """A quarter of a second low."""
        self._port.send_break(0.25)
