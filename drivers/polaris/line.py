"""The serial line to a tracker: what the loop's seam gives, and break and baud rate beside."""

from typing import Protocol

from hal.errors import BackendError
from hal.seams import SerialLine


class TrackerLine(SerialLine, Protocol):
    """A :class:`hal.seams.SerialLine` that a tracker can be reset through."""

    def set_baud(self, baud: int) -> None:
        """Go on at another rate, 8N1."""

    def send_break(self) -> None:
        """Hold the line low: the tracker starts anew, at 9600."""


class TrackerPort:
    """Through pyserial, non-blocking. Raises BackendError if the port cannot be opened."""

    def __init__(self, path: str) -> None:
        import serial  # only where there is a line

        self._errors = (serial.SerialException, OSError)
        try:
            self._port = serial.Serial(path, 9600, timeout=0, write_timeout=1.0)
        except (*self._errors, ValueError) as error:
            raise BackendError("the tracker's port cannot be opened", value=path, remedy=f"check its name and your rights, on Debian the group dialout ({error})") from None  # fmt: skip

    def receive(self, buffer: bytearray) -> int:
        """What waits, or -1."""
        try:
            return self._port.readinto(buffer) or -1
        except self._errors:
            return -1

    def send(self, data: bytes | bytearray) -> None:
        """Send; a line that is gone shows as silence."""
        try:
            self._port.write(data)
        except self._errors:
            return

    def set_baud(self, baud: int) -> None:
        """Go on at another rate."""
        self._port.baudrate = baud

    def send_break(self) -> None:
        """A quarter of a second low."""
        self._port.send_break(0.25)

    def close(self) -> None:
        """Release the port."""
        self._port.close()
