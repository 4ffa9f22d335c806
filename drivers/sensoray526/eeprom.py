"""The factory's calibration in the card's EEPROM (07 section 1.3)."""

import struct
from dataclasses import dataclass

import numpy as np

from drivers.sensoray526.registers import (
    EEPROM_COMMAND,
    EEPROM_DATA,
    EEPROM_DONE,
    EEPROM_READ,
    INTERRUPT_STATUS,
    OUTPUTS,
    Batch,
)
from hal.errors import BackendError
from hal.seams import PortIO

WORDS = 0x24
DONE_POLLS = 10_000
NOMINAL_GAIN, NOMINAL_OFFSET, NOMINAL_REFERENCE_V = 65536 / 20, 32768.0, 10.0
TOLERANCE = 0.05


@dataclass(frozen=True)
class Calibration:
    """What one card's factory measured.

    Attributes:
        gain, offset: of each output, code = gain · V + offset [1/V, 1].
        reference_v: of the converter's channel 8 [V].
    """

    gain: tuple[float, ...]
    offset: tuple[float, ...]
    reference_v: float


def read_calibration(ports: PortIO, base: int) -> Calibration:
    """Read the EEPROM and refuse what no factory would have written. Raises BackendError."""
    return parse(read_words(ports, base))


def read_words(ports: PortIO, base: int) -> np.ndarray:
    """The 36 words (36,) that hold the calibration. Raises BackendError if it does not answer."""
    batch, places = Batch(base), []
    for address in range(WORDS):
        batch.write(INTERRUPT_STATUS, EEPROM_DONE)
        batch.write(EEPROM_COMMAND, address << 3 | EEPROM_READ)
        batch.poll(INTERRUPT_STATUS, EEPROM_DONE, DONE_POLLS)
        batch.write(INTERRUPT_STATUS, EEPROM_DONE)
        places.append(batch.read(EEPROM_DATA))
    operations = batch.build()
    missed = ports.execute(operations)
    if missed:
        raise BackendError("the card's EEPROM does not answer", value=f"{missed} of {WORDS} words missing", remedy="switch the card off and on; replace it if it stays")  # fmt: skip
    return operations["result"][places].astype("<u2")


def parse(words: np.ndarray) -> Calibration:
    """Little-endian doubles: gain and offset of each output, then the reference. Raises BackendError."""
    values = struct.unpack(f"<{2 * OUTPUTS + 1}d", words.astype("<u2").tobytes())
    gain, offset = values[0 : 2 * OUTPUTS : 2], values[1 : 2 * OUTPUTS : 2]
    for channel in range(OUTPUTS):
        _check(f"gain of output {channel}", gain[channel], NOMINAL_GAIN)
        _check(f"offset of output {channel}", offset[channel], NOMINAL_OFFSET)
    _check("reference", values[-1], NOMINAL_REFERENCE_V)
    return Calibration(gain, offset, values[-1])


def _check(what: str, value: float, nominal: float) -> None:
    if not abs(value - nominal) <= TOLERANCE * nominal:
        low, high = (1.0 - TOLERANCE) * nominal, (1.0 + TOLERANCE) * nominal
        raise BackendError(f"the card's EEPROM holds no calibration: {what}", value=value, bound=f"{low:g} .. {high:g}", remedy="have the card calibrated, or replace it")  # fmt: skip
