"""The double of the load cell. It is written from the manual, not from the driver, and can be broken in six ways."""

import struct
import zlib
from collections.abc import Mapping
from typing import Any

from hal.emulator import Bench, Station
from hal.errors import BackendError


class EmulatedLoadCell:
    """See :class:`hal.emulator.Emulator`."""

    faults = ("silence", "corrupt", "drop", "freeze", "reboot", "not_a_number")
    apart = True  # a process of its own on the bench: only UDP ties it to the others

    def __init__(self, name: str, table: Mapping[str, Any], station: Station) -> None:  # noqa: ARG002
        self._line = station.switchboard.plug_datagrams(table["local"], table["peer"])
        self._number = 0xFFFFFF00  # it wraps soon, as every counter does one day
        self._datagram = b""
        self._fault = dict.fromkeys(self.faults, 0.0)

    def sense(self, tick: int, bench: Bench) -> None:  # noqa: ARG002
        """A millisecond has passed: one datagram."""
        fault = self._fault
        if fault["reboot"] > 0:
            fault["reboot"] -= 1
            self._number = -1
            return
        if not fault["freeze"]:
            self._number = (self._number + 1) & 0xFFFFFFFF
            wrench = bench.wrench_in_sensor.copy()
            if fault["not_a_number"]:
                wrench[2] = float("nan")
            body = b"LCEL" + struct.pack(">I", self._number) + struct.pack(">6f", *wrench)
            crc = zlib.crc32(body) ^ (1 if fault["corrupt"] else 0)
            self._datagram = body + struct.pack(">I", crc)
        if fault["drop"] > 0:
            fault["drop"] -= 1
        elif not fault["silence"]:
            self._line.send(self._datagram)

    def drive(self, tick: int, bench: Bench) -> None:
        """It moves nothing."""

    def inject(self, fault: str, value: float = 1.0) -> None:
        """Break it; 0 mends it. "drop" loses the next `value` datagrams, "reboot" lasts so many ticks. Raises BackendError."""
        if fault not in self._fault:
            raise BackendError("the load cell knows no such fault", value=fault, bound=" | ".join(self.faults))
        self._fault[fault] = value
