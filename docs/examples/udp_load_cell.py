"""A six-axis load cell that sends its readings by UDP, a thousand a second, without being asked.

Its manual: 36 bytes, big-endian: "LCEL", u32 number (from 0 at power-on, +1 a datagram, wraps), six float32 Fx Fy Fz [N]
Mx My Mz [N mm], u32 CRC-32 of the 32 bytes before. Its zero outlives a restart, which takes a second.
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
DRAIN = 64
"""Datagrams taken in one tick at most: what a flood leaves over waits for the next."""
LIMIT = 1e6
"""No load cell measures so much, in N or N mm."""


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
        self._number = self._heard = -1
        self._sequence = self._age = self._refused = self._lost = 0
        self._wrench: list[float] = []

    def open(self) -> None:
        """Raises BackendError for an address that cannot be had."""
        self._restart()
        self._line = self._site.seams.datagrams(self.options.local, self.options.peer)

    def begin(self, tick: int) -> None:
        """It measures by itself."""

    def read(self, tick: int, readings: Readings) -> None:
        """Take what has come; the newest counts."""
        if self._line is None:
            return
        if self._heard < 0:
            self._heard = tick  # silence counts from the first tick on
        refused, lost = self._refused, self._lost
        for _ in range(DRAIN):
            size = self._line.receive(self._buffer)
            if size < 0:
                break
            self._take(tick, size)
        if self._refused > refused:
            readings.report(Trouble.DATAGRAM_CORRUPT, self._refused - refused)
        if self._lost > lost:
            readings.report(Trouble.DATAGRAM_GAP, self._lost - lost)
        self._age = tick - self._heard
        if self._age > self.options.silent_ticks:
            readings.report(Trouble.SENSOR_SILENT, self._age)
        if self._sequence > 0:
            readings.wrench_sequence, readings.wrench_age_ticks = self._sequence, self._age
            if self._age <= self.options.silent_ticks:
                readings.wrench_validity = VALID
                readings.wrench_in_sensor[:] = self._wrench

    def _take(self, tick: int, size: int) -> None:
        """One datagram: refused unless sound, and no news unless newer than what is known."""
        magic, number, *wrench, crc = DATAGRAM.unpack_from(self._buffer)
        sound = size == DATAGRAM.size and magic == b"LCEL" and crc == zlib.crc32(self._buffer[:32])
        if not (sound and all(abs(v) < LIMIT for v in wrench)):  # NaN is not below anything
            self._refused += 1
            return
        step = (number - self._number) & 0xFFFFFFFF
        if self._sequence == 0 or tick - self._heard > self.options.silent_ticks:
            step = min(step, 1)  # the first, or switched off and on: its numbers say nothing, unless it repeats itself
        if step == 0 or step > 0x7FFFFFFF:
            return  # a double, or a late one
        self._number, self._heard, self._wrench = number, tick, wrench
        self._sequence += step
        self._lost += step - 1

    def write(self, tick: int, demand: Demand) -> None:
        """It is not commanded."""

    def close(self) -> None:
        """Let go of the socket."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def health(self) -> Health:
        """For ``rtctl devices list``."""
        foreign = self._line.foreign if self._line is not None else 0
        errors = {"refused": self._refused, "lost": self._lost, "foreign": foreign}
        return Health(
            f"load cell at {self.options.peer}", age_ticks=self._age if self._sequence else NEVER, errors=errors
        )

    def probe(self) -> list[Finding]:
        """For ``rtctl devices probe``."""
        heard = self._sequence > 0 and self._age <= self.options.silent_ticks
        return [Finding("readings", "come" if heard else "none", heard, "check its cable, and where it sends to")]
