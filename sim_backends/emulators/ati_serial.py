"""An ATI stand-alone controller behind its serial line, byte by byte in time (07 section 3.5)."""

import struct
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from hal.emulator import Bench, Station
from hal.errors import BackendError
from sim_backends.emulators.transducer import out_of_f

NEWTONS = {"N": 1.0, "lbf": 4.44822161526}
NEWTON_MM = {"N-mm": 1.0, "N-m": 1e3, "lbf-in": 112.984829028}
BITS_A_BYTE = 10
JUNK = 0xA5


class EmulatedAtiSerial:
    """Echoes what it hears, obeys at a carriage return, and takes its time for every byte in both directions.

    It starts as from its switch: ASCII, resolved. Commands: CD A, CD B, CD R, QR, QS (until the next carriage return), SB,
    SZ; another one is an error text.

    Faults: "drop_byte" (the next so many bytes get lost), "insert_byte" (before so many bytes comes a wrong one),
    "silence" (the cable is out), "error_record" (its records carry this error).
    """

    faults = ("drop_byte", "insert_byte", "silence", "error_record")
    apart = True

    def __init__(self, name: str, table: Mapping[str, Any], station: Station) -> None:  # noqa: ARG002
        self._link = station.switchboard.plug_serial(table["path"])
        self._out_of_f, self._bytes_a_tick = out_of_f(table), table.get("baud", 38400) / BITS_A_BYTE * station.period_s
        force, torque = NEWTONS[table["force_unit"]], NEWTON_MM[table["torque_unit"]]
        self._counts_per = np.array([table["counts_per_force"] / force] * 3 + [table["counts_per_torque"] / torque] * 3)
        self._heard, self._said = deque[int](), deque[int]()
        self._heard_credit = self._said_credit = 0.0
        self._command = bytearray()
        self._binary = self._streaming = False
        self._counts, self._bias = np.zeros(6), np.zeros(6)
        self._level = dict.fromkeys(self.faults, 0.0)
        self._chunk = bytearray(64)

    def sense(self, tick: int, bench: Bench) -> None:  # noqa: ARG002
        """A tick of bytes comes in and goes out."""
        self._counts = np.round(self._out_of_f @ bench.wrench_in_sensor * self._counts_per)
        while (size := self._link.receive(self._chunk)) > 0:
            if not self._level["silence"]:
                self._heard.extend(self._chunk[:size])
        self._speak()
        self._heard_credit += self._bytes_a_tick
        while self._heard and self._heard_credit >= 1.0:
            self._heard_credit -= 1.0
            self._hear(self._heard.popleft())
        if not self._heard:
            self._heard_credit = 0.0
        if self._streaming and not self._said:
            self._said.extend(self._record() + (b"" if self._binary else b"\r\n"))

    def _speak(self) -> None:
        """What was said before this tick goes out, as much as a tick can carry; time without bytes is lost."""
        out = bytearray()
        self._said_credit += self._bytes_a_tick
        while self._said and self._said_credit >= 1.0:
            self._said_credit -= 1.0
            self._transmit(self._said.popleft(), out)
        if not self._said:
            self._said_credit = 0.0
        if out and not self._level["silence"]:
            self._link.send(out)

    def _hear(self, byte: int) -> None:
        self._said.append(byte)
        if byte != 0x0D:
            self._command.append(byte)
            return
        if self._streaming:
            self._streaming = False
            self._said.clear()
        self._said.extend(self._obey(bytes(self._command)) + b"\r\n>")
        self._command.clear()

    def _obey(self, command: bytes) -> bytes:
        if command in (b"CD A", b"CD B"):
            self._binary = command == b"CD B"
        elif command == b"QR":
            return self._record()
        elif command == b"QS":
            self._streaming = True
        elif command == b"SB":
            self._bias = self._counts.copy()
        elif command == b"SZ":
            self._bias = np.zeros(6)
        elif command not in (b"", b"CD R"):
            return b"E: unknown command"
        return b""

    def _record(self) -> bytes:
        counts = np.clip(self._counts - self._bias, -32768, 32767).astype(int).tolist()
        error = int(self._level["error_record"])
        if self._binary:
            return struct.pack(">B6h", error, *counts)
        return f"{error},{','.join(f'{n:6d}' for n in counts)}".encode()

    def _transmit(self, byte: int, out: bytearray) -> None:
        if self._level["drop_byte"] > 0:
            self._level["drop_byte"] -= 1
            return
        if self._level["insert_byte"] > 0:
            self._level["insert_byte"] -= 1
            out.append(JUNK)
        out.append(byte)

    def drive(self, tick: int, bench: Bench) -> None:
        """A sensor only measures."""

    def inject(self, fault: str, value: float = 1.0) -> None:
        """Break something; 0 mends it. Raises BackendError."""
        if fault not in self._level:
            raise BackendError("no such fault of an emulated controller", value=fault, bound=" | ".join(self.faults))
        if fault == "error_record" and value not in range(256):
            raise BackendError("no such error", value=value, bound="1 .. 255, 0 mends")
        self._level[fault] = value
