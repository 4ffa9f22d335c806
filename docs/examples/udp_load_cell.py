"""A six-axis load cell that sends its readings by UDP, a thousand a second, without being asked.

Its manual: 36 bytes, big-endian: "LCEL", u32 sequence (+1 a datagram), six float32 Fx Fy Fz [N] Mx My Mz [N mm], u32 CRC-32
of the 32 bytes before.
"""

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hal import options
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.frames import VALID
from hal.options import option
from hal.seams import Datagrams
from hal.troubles import Trouble

DATAGRAM = struct.Struct(">4sI6fI")


@dataclass(frozen=True)
class LoadCellOptions:
    """Settings of a device "udp_load_cell"."""

    peer: str = option(doc='the load cell\'s "address:port"')
    local: str = option(doc='"address:port" of this machine that it sends to')
    silent_ticks: int = option(5, low=1, high=1000, doc="ticks without a reading after which there is no wrench")


class LoadCell:
    """See :class:`hal.device.Device`."""

    options_type = LoadCellOptions
    axes: tuple[int, ...] = ()
    measures = frozenset({"wrench"})

    def __init__(self, name: str, table: Mapping[str, Any], site: Site) -> None:
        self.options = options.read(LoadCellOptions, table, f"device {name}")
        self._site = site
        self._line: Datagrams | None = None
        self._buffer = bytearray(64)
        self._restart()

    def _restart(self) -> None:
        self._sequence, self._sampled, self._wrench = -1, -1, (0.0,) * 6
        self._refused = self._lost = 0

    def open(self) -> None:
        """Raises BackendError for an address that cannot be had."""
        self._restart()
        self._line = self._site.seams.datagrams(self.options.local, self.options.peer)

    def begin(self, tick: int) -> None:
        """It measures by itself."""

    def read(self, tick: int, readings: Readings) -> None:
        """Take all that has come; the newest counts."""
        if self._line is None:
            return
        refused = lost = 0
        while (size := self._line.receive(self._buffer)) >= 0:
            magic, sequence, *wrench, crc = DATAGRAM.unpack_from(self._buffer)
            sound = size == DATAGRAM.size and magic == b"LCEL" and crc == zlib.crc32(self._buffer[: size - 4])
            if not (sound and all(abs(v) < 1e6 for v in wrench)):  # NaN is not below anything
                refused += 1
                continue
            step = (sequence - self._sequence) & 0xFFFFFFFF
            if self._sequence >= 0 and step > 0x7FFFFFFF:
                continue  # older than what is known
            lost += step - 1 if self._sequence >= 0 and step > 0 else 0
            self._sequence, self._sampled, self._wrench = sequence, tick, tuple(wrench)
        self._refused, self._lost = self._refused + refused, self._lost + lost
        age = tick - self._sampled if self._sampled >= 0 else NEVER
        readings.wrench_sequence, readings.wrench_age_ticks = max(self._sequence, 0), age
        if age <= self.options.silent_ticks:
            readings.wrench_validity = VALID
            readings.wrench_in_sensor[:] = self._wrench
        else:
            readings.report(Trouble.SENSOR_SILENT, min(age, tick))
        if refused:
            readings.report(Trouble.DATAGRAM_CORRUPT, self._refused)
        if lost:
            readings.report(Trouble.DATAGRAM_GAP, self._lost)

    def write(self, tick: int, demand: Demand) -> None:
        """It is not commanded."""

    def close(self) -> None:
        """Let go of the socket."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def health(self) -> Health:
        """For ``rtctl devices list``."""
        return Health(f"load cell at {self.options.peer}", errors={"refused": self._refused, "lost": self._lost})

    def probe(self) -> list[Finding]:
        """For ``rtctl devices probe``."""
        heard = self._sampled >= 0
        return [Finding("readings", "come" if heard else "none", heard, "check its cable, and where it sends to")]
