"""The double of the load cell. It is written from the manual, not from the driver, and can be broken in four ways."""

import struct
import zlib
from collections.abc import Mapping
from typing import Any

from hal.emulator import Bench, Station
from hal.errors import BackendError


class EmulatedLoadCell:
    """See :class:`hal.emulator.Emulator`."""

    faults = ("silence", "corrupt", "drop", "not_a_number")
    apart = True  # a process of its own on the bench: only UDP ties it to the others

    def __init__(self, name: str, table: Mapping[str, Any], station: Station) -> None:  # noqa: ARG002
        self._line = station.switchboard.plug_datagrams(table["local"], table["peer"])
        self._sequence = 0xFFFFFFF0  # it wraps soon, as every counter does one day
        self._fault = dict.fromkeys(self.faults, 0.0)

    def sense(self, tick: int, bench: Bench) -> None:  # noqa: ARG002
        """A millisecond has passed: one datagram."""
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        wrench = bench.wrench_in_sensor.copy()
        if self._fault["not_a_number"]:
            wrench[2] = float("nan")
        body = b"LCEL" + struct.pack(">I", self._sequence) + struct.pack(">6f", *wrench)
        crc = zlib.crc32(body) ^ (1 if self._fault["corrupt"] else 0)
        if self._fault["drop"] > 0:
            self._fault["drop"] -= 1
        elif not self._fault["silence"]:
            self._line.send(body + struct.pack(">I", crc))

    def drive(self, tick: int, bench: Bench) -> None:
        """It moves nothing."""

    def inject(self, fault: str, value: float = 1.0) -> None:
        """Break it; 0 mends it. "drop" loses the next `value` datagrams. Raises BackendError for another name."""
        if fault not in self._fault:
            raise BackendError("the load cell knows no such fault", value=fault, bound=" | ".join(self.faults))
        self._fault[fault] = value
