"""One scan of the converter: all inputs and both references in one command (07 section 1.3)."""

from numba.types import boolean, float64, int32, int64

from drivers.sensoray526.registers import (
    ADC_CONTROL,
    ADC_DONE,
    ANALOG_DATA,
    GROUND,
    INTERRUPT_STATUS,
    REFERENCE,
    Batch,
    scan_command,
)
from hal.kernel import kernel

FULL_SCALE = 32768.0
TOP = 0x7FFF
NEAR_RAIL = 0.995 * FULL_SCALE
GAIN_TOLERANCE = 0.01
OFFSET_TOLERANCE_LSB = 50.0


def scanned(inputs: list[int]) -> tuple[int, ...]:
    """The channels of a scan: the references, so that the converter's drift cancels, then the inputs."""
    return (REFERENCE, GROUND, *inputs)


def add_start(batch: Batch, channels: tuple[int, ...]) -> None:
    """Forget that an earlier scan was done, and start this one."""
    batch.write(INTERRUPT_STATUS, ADC_DONE)
    batch.write(ADC_CONTROL, scan_command(channels))


def add_collecting(batch: Batch, channels: tuple[int, ...], poll_limit: int) -> int:
    """Wait for the scan, then read every result; place of the first selection, followed by its word, and so on."""
    batch.poll(INTERRUPT_STATUS, ADC_DONE, poll_limit)
    batch.write(INTERRUPT_STATUS, ADC_DONE)
    first = len(batch)
    for channel in channels:
        batch.write(ADC_CONTROL, channel << 1)
        batch.read(ANALOG_DATA)
    return first


@kernel
def signed(word):
    """A 16-bit word as two's complement."""
    return (word & 0xFFFF ^ 0x8000) - 0x8000


@kernel(signature=float64(int32[:], int64[:], float64, int32[:], float64[:], boolean[:]))
def decode(words, inputs, reference_v, code, voltage_v, railed):
    """Voltages of `inputs` (k,) from the results (2 + k,) of a scan: V = Vref (D - D9) / (D8 - D9).

    Returns:
        by how much the references are out of their bounds, or 0: the gain's error [%], or the offset's of full scale
        [%]. A +10 V reference at the end of the range could be any voltage above: it counts as off by the bound.
        Codes, voltages and railed are written in any case.
    """
    ground = signed(words[1])
    span = signed(words[0]) - ground
    scale = reference_v / span
    for i in range(len(inputs)):
        word = signed(words[2 + i])
        code[inputs[i]] = word
        voltage_v[inputs[i]] = scale * (word - ground)
        railed[inputs[i]] = abs(word) >= NEAR_RAIL
    gain = span * (10.0 / reference_v) / FULL_SCALE - 1.0
    if words[0] == TOP:
        return 100.0 * GAIN_TOLERANCE
    if abs(gain) > GAIN_TOLERANCE:
        return 100.0 * gain
    if abs(ground) > OFFSET_TOLERANCE_LSB:
        return 100.0 * ground / FULL_SCALE
    return 0.0
