"""The box of a Net F/T behind its UDP port (07 section 3.4)."""

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from hal.emulator import Bench, Station
from hal.errors import BackendError
from hal.seams import Datagrams
from sim_backends.emulators.transducer import out_of_f

NEWTONS = {"N": 1.0, "lbf": 4.44822161526}
NEWTON_MM = {"N-mm": 1.0, "N-m": 1e3, "lbf-in": 112.984829028}
INTERNAL_HZ = 7000
LARGEST = 2**31 - 1


class EmulatedNetFt:
    """Answers requests and sends a record a tick, whatever becomes of it.

    Requests that do not have its layout are ignored. A command starts an endless stream or one of so many records, ends it,
    or sets the bias; every start begins a new count of records.

    Faults: "drop" and "corrupt" (the next so many records are lost, are a byte short), "duplicate", "reorder" (a record
    comes twice, changes places with the next), "freeze_ft" (one sample again and again), "reboot" (power fails for so many
    ticks; biases and streams are forgotten), "status" (this bit and the summary are set), "silence" (its cable is out)."""

    faults = ("drop", "duplicate", "reorder", "freeze_ft", "reboot", "status", "silence", "corrupt")
    apart = True

    def __init__(self, name: str, table: Mapping[str, Any], station: Station) -> None:  # noqa: ARG002
        address = table.get("address", "192.168.1.1:49152")
        self._link: Datagrams = station.switchboard.plug_datagrams(table.get("local", ""), address)
        self._out_of_f, self._samples = out_of_f(table), round(INTERNAL_HZ * station.period_s)
        force, torque = NEWTONS[table["force_unit"]], NEWTON_MM[table["torque_unit"]]
        self._counts_per = np.array([table["counts_per_force"] / force] * 3 + [table["counts_per_torque"] / torque] * 3)
        self._bias, self._counts = np.zeros(6), np.zeros(6)
        self._rdt, self._ft, self._left = 0, 0, 0
        self._level = dict.fromkeys(self.faults, 0.0)
        self._held: bytes | None = None
        self._request = bytearray(64)

    def sense(self, tick: int, bench: Bench) -> None:  # noqa: ARG002
        """A tick of the box: requests are answered, a record goes out if somebody asked."""
        if self._level["reboot"] > 0:
            self._level["reboot"] -= 1
            while self._link.receive(self._request) >= 0:
                pass
            return
        if not self._level["freeze_ft"]:
            self._ft = (self._ft + self._samples) % 2**32
            raw = np.round(self._out_of_f @ bench.wrench_in_sensor * self._counts_per)
            self._counts = np.clip(raw - self._bias, -LARGEST, LARGEST)
        while (size := self._link.receive(self._request)) >= 0:
            if not self._level["silence"]:
                self._obey(bytes(self._request[: min(size, len(self._request))]))
        if self._left != 0:
            self._left -= self._left > 0
            self._rdt = (self._rdt + 1) % 2**32
            self._send(self._record())

    def _obey(self, request: bytes) -> None:
        if len(request) != 8:
            return
        magic, command, count = struct.unpack(">HHI", request)
        if magic != 0x1234:
            return
        if command == 0:
            self._left = 0
        elif command in (2, 3):
            self._left, self._rdt = count or -1, 0
        elif command == 0x42:
            self._bias = self._bias + self._counts

    def _record(self) -> bytes:
        bit = self._level["status"]
        status = (1 << int(bit) | 1 << 31) if bit else 0
        return struct.pack(">III6i", self._rdt, self._ft, status, *self._counts.astype(int).tolist())

    def _send(self, record: bytes) -> None:
        level = self._level
        if level["silence"]:
            return
        if level["drop"] > 0:
            level["drop"] -= 1
            return
        if level["reorder"] > 0 and self._held is None:
            level["reorder"] -= 1
            self._held = record
            return
        if level["corrupt"] > 0:
            level["corrupt"] -= 1
            record = record[:-1]
        self._link.send(record)
        if level["duplicate"] > 0:
            level["duplicate"] -= 1
            self._link.send(record)
        if self._held is not None:
            self._link.send(self._held)
            self._held = None

    def drive(self, tick: int, bench: Bench) -> None:
        """A sensor only measures."""

    def inject(self, fault: str, value: float = 1.0) -> None:
        """Break something; 0 mends it. Raises BackendError."""
        if fault not in self._level:
            raise BackendError("no such fault of an emulated Net F/T", value=fault, bound=" | ".join(self.faults))
        if fault == "status" and value not in range(32):
            raise BackendError("no such status bit", value=value, bound="1 .. 31, 0 mends")
        if fault == "reboot" and value:
            self._left, self._ft, self._bias, self._held = 0, 0, np.zeros(6), None
        self._level[fault] = value
