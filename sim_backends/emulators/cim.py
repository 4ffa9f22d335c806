"""The computer of the implant, as far as its telemetry shows it: ICZ1 datagrams of what the bench's contacts read (07 section 4).

It sends when the bench has a new sample, from the device's `peer` to its `local`. Faults, by :meth:`EmulatedCim.inject`:

    silence       nothing is sent
    drop          the next `value` datagrams are lost
    duplicate     the next `value` datagrams come twice
    reorder       the next `value` datagrams each come after the one behind them
    new_run       once: the sender starts anew
    corrupt_crc   a bit of every datagram is wrong
    bad_length    every datagram lacks its last byte
    freeze        every pair reads what it read when it was measured first from now on
    open, short   pair `value` - 1 is an open circuit, or a short (0 mends it, so the pair at the tip is 1)
    foreign       another protocol's datagrams come between ours
"""

import struct
import zlib
from collections.abc import Mapping
from typing import Any

from hal.emulator import Bench, Station
from hal.errors import BackendError, OptionError

DATAGRAM = struct.Struct(">4sBBHIIQBBBBffII")
"""All but the CRC."""
SIZE = 48
ELECTRODES = 22
OPEN_OHM, SHORT_OHM, LEAST_OHM, MOST_OHM = 28_800.0, 20.0, 0.5, 40_000.0
FLAG_OPEN, FLAG_SHORT, FLAG_SWEEP_START, FLAG_SIMULATED = 1, 2, 8, 16
MASK = 0xFFFFFFFF
ANOTHER_PROTOCOL = b"\x12\x34" + bytes(34)
"""As a Net F/T sends it."""


class EmulatedCim:
    """See :class:`hal.emulator.Emulator`. Its switchboard may as well hand out a socket: whatever has `send`."""

    apart = True
    faults = ("silence", "drop", "duplicate", "reorder", "new_run", "corrupt_crc", "bad_length", "freeze", "open", "short", "foreign")  # fmt: skip

    def __init__(self, name: str, table: Mapping[str, Any], station: Station) -> None:
        if table.get("decoder", "icz1") != "icz1":
            raise OptionError(f"the emulated telemetry of {name} speaks another layout", value=table["decoder"], bound="icz1")  # fmt: skip
        self._link = station.switchboard.plug_datagrams(table["local"], table["peer"])
        self._step = int(table.get("pair_step", 1))
        self._tip = int(table.get("tip_electrode", ELECTRODES))
        self._period_us = station.period_s * 1e6
        self._run = (station.seed * 2_654_435_761 + 1) & MASK
        self._booted_us = 3_600_000_000 + self._run
        self._sequence = self._sweep = 0
        self._last_position = -1
        self._sampled = 0
        self._fault = dict.fromkeys(self.faults, 0)
        self._frozen: dict[int, float] = {}
        self._held: bytes | None = None

    def sense(self, tick: int, bench: Bench) -> None:
        """Send the bench's latest sample, if it is a new one."""
        if bench.impedance_sequence == self._sampled:
            return
        self._sampled = bench.impedance_sequence
        if bench.impedance_sequence == 0 or bench.impedance_pair < 0:
            return
        data = self._datagram(tick, bench.impedance_pair, self._reading(bench.impedance_pair, bench.impedance_ohm))
        if not self._fault["silence"]:
            self._send(self._damage(data))

    def drive(self, tick: int, bench: Bench) -> None:
        """It has no outputs."""

    def inject(self, fault: str, value: float = 1.0) -> None:
        """See the head of this file."""
        if fault not in self.faults:
            raise BackendError("the emulated telemetry knows no such fault", value=fault, bound=" | ".join(self.faults))
        self._fault[fault] = int(value)
        if fault == "new_run" and value:
            self._run = (self._run * 1_664_525 + 1_013_904_223) & MASK
            self._sequence = self._sweep = 0
            self._last_position = -1
            self._booted_us = 60_000_000
        if fault == "freeze":
            self._frozen.clear()

    def _reading(self, pair: int, ohm: float) -> float:
        if self._fault["freeze"]:
            ohm = self._frozen.setdefault(pair, ohm)
        if self._fault["open"] == pair + 1:
            return OPEN_OHM
        if self._fault["short"] == pair + 1:
            return SHORT_OHM
        return min(max(ohm, LEAST_OHM), MOST_OHM)

    def _datagram(self, tick: int, pair: int, ohm: float) -> bytes:
        """Pairs are measured from the tip on; the more basal electrode drives, the more apical one takes the return."""
        self._sweep = (self._sweep + (pair <= self._last_position)) & MASK
        self._last_position = pair
        flags = FLAG_SIMULATED | FLAG_SWEEP_START * (pair == 0)
        flags |= FLAG_OPEN * (ohm >= OPEN_OHM) | FLAG_SHORT * (ohm <= SHORT_OHM)
        body = DATAGRAM.pack(
            b"ICZ1", 1, flags, SIZE, self._run, self._sequence, self._booted_us + round(tick * self._period_us),
            self._electrode(pair + self._step), self._electrode(pair), pair, ELECTRODES - self._step,
            ohm, float("nan"), self._sweep, 0,
        )  # fmt: skip
        self._sequence = (self._sequence + 1) & MASK
        return body + struct.pack(">I", zlib.crc32(body))

    def _electrode(self, contact_from_tip: int) -> int:
        return ELECTRODES - contact_from_tip if self._tip == ELECTRODES else contact_from_tip + 1

    def _damage(self, data: bytes) -> bytes:
        if self._fault["corrupt_crc"]:
            data = data[:30] + bytes([data[30] ^ 0x10]) + data[31:]
        return data[:-1] if self._fault["bad_length"] else data

    def _send(self, data: bytes) -> None:
        if self._fault["foreign"]:
            self._link.send(ANOTHER_PROTOCOL)
        if self._takes("drop"):
            return
        held, self._held = self._held, None
        if held is None and self._takes("reorder"):
            self._held = data
            return
        self._link.send(data)
        if held is not None:
            self._link.send(held)
        if self._takes("duplicate"):
            self._link.send(data)

    def _takes(self, fault: str) -> bool:
        """True while a fault that was injected for so many datagrams has some left; uses one of them."""
        left = self._fault[fault]
        self._fault[fault] = max(left - 1, 0)
        return left > 0
