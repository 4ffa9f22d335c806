"""Registers of the Sensoray 526 and batches of accesses to them (07 sections 1.2 and 1.3).

Offsets are from the card's base; all accesses are of 16 bits.
"""

import numpy as np

from hal.seams import OPERATION, Kind

SIZE = 0x40
COUNTERS, OUTPUTS, INPUTS, LINES, LINES_A_GROUP = 4, 4, 8, 8, 4

WATCHDOG = 0x02
DAC_CONTROL = 0x04
ADC_CONTROL = 0x06
ANALOG_DATA = 0x08
DIGITAL = 0x0A
INTERRUPT_STATUS = 0x0E
EEPROM_DATA = 0x32
EEPROM_COMMAND = SIGNATURE = 0x34
SIGNATURES = (0x526A, 0x526B)

WATCHDOG_INVERTED, WATCHDOG_ENABLE = 0x10, 0x08
DAC_RESET, DAC_START = 0x08, 0x01
ADC_SETTLE, ADC_START = 0x8000, 0x01
REFERENCE, GROUND = 8, 9
"""The converter's own channels: +10 V and 0 V."""
GROUP_OUTPUT = (0x0400, 0x0800)
"""Direction bits of the lines 0-3 and 4-7."""
EEPROM_DONE, ADC_DONE = 0x80, 0x04
EEPROM_READ = 0x05

QUADRATURE_X4, COUNT_ENABLE, LATCH_ON_EVENT, SELECT_PRELOAD_1 = 0x0400, 0x0080, 0x2000, 0x4000
RUNNING = QUADRATURE_X4 | COUNT_ENABLE
ERROR_CAPTURED, INDEX_FELL, INDEX_ROSE, EVENTS = 0x1, 0x2, 0x4, 0xF
LATCH_AT_FALL, LATCH_AT_RISE, LOAD = 0x0400, 0x0800, 0x4000


def counter_low(channel: int) -> int:
    """Low word: preload when written; reading it latches all 24 bits, or after an event shows what that latched."""
    return 0x12 + 8 * channel


def counter_high(channel: int) -> int:
    """Bits 23:16 of what the low word latched."""
    return 0x14 + 8 * channel


def counter_mode(channel: int) -> int:
    """How it counts."""
    return 0x16 + 8 * channel


def counter_control(channel: int) -> int:
    """Its events (write 1 to clear) and what latches it."""
    return 0x18 + 8 * channel


def scan_command(channels: tuple[int, ...]) -> int:
    """Word that converts `channels` in one go, with time for the multiplexer to settle before each."""
    enabled = sum(1 << (5 + channel) for channel in channels)
    return ADC_SETTLE | enabled | ADC_START


class Batch:
    """Accesses to one card in the order they are added."""

    def __init__(self, base: int) -> None:
        self._base = base
        self._rows: list[tuple[int, ...]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def read(self, offset: int) -> int:
        """Add a read; its place in the batch."""
        return self._add(Kind.READ, offset, 0, 0, 0)

    def write(self, offset: int, word: int) -> int:
        """Add a write; its place in the batch."""
        return self._add(Kind.WRITE, offset, word, 0, 0)

    def poll(self, offset: int, mask: int, limit: int) -> int:
        """Add reads until all bits of `mask` are set, at most `limit`; the place in the batch."""
        return self._add(Kind.POLL, offset, mask, mask, limit)

    def build(self) -> np.ndarray:
        """The operations (n,) of OPERATION."""
        return np.array(self._rows, OPERATION)

    def _add(self, kind: Kind, offset: int, value: int, mask: int, limit: int) -> int:
        self._rows.append((int(kind), self._base + offset, value, mask, limit, 0))
        return len(self._rows) - 1
