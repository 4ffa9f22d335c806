"""What goes out of a card: analog outputs, lines, and the watchdog's petting (07 section 1.3)."""

import numpy as np

from drivers.sensoray526.eeprom import Calibration
from drivers.sensoray526.options import Sensoray526Options, pets, watchdog_word
from drivers.sensoray526.registers import (
    ANALOG_DATA,
    DAC_CONTROL,
    DAC_RESET,
    DAC_START,
    DIGITAL,
    OUTPUTS,
    WATCHDOG,
    WATCHDOG_ENABLE,
    Batch,
)
from hal.seams import PortIO


class Outputs:
    """Stages the outputs of `used`, starts them together, writes the lines whole, pets the watchdog; one batch a tick.

    Args:
        options: of the card. calibration: of its outputs.
        used: outputs that are written every tick; the others stay at 0 V.
        lines: the lines' register with their directions and nothing high.

    Attributes:
        written_v: of each output [V], since the last write. armed: the watchdog runs, or there is none.
    """

    def __init__(self, options: Sensoray526Options, calibration: Calibration, used: list[int], lines: int) -> None:
        self.written_v = [0.0] * OUTPUTS
        self.armed = False
        self._calibration, self._used, self._lines = calibration, used, lines
        self._build_tick(options)
        self._build_rest(options)
        self._arming = np.empty(0)
        if options.watchdog_code >= 0:
            batch = Batch(options.base)
            batch.write(WATCHDOG, watchdog_word(options) & ~WATCHDOG_ENABLE)
            batch.write(WATCHDOG, watchdog_word(options))
            self._arming = batch.build()

    def code(self, channel: int, voltage_v: float) -> int:
        """Word for a voltage [V] on an output, 0 .. 65535."""
        c = self._calibration
        return min(max(round(c.gain[channel] * voltage_v + c.offset[channel]), 0), 0xFFFF)

    def reset(self, ports: PortIO) -> None:
        """Watchdog off, lines low, converters reset, then 0 V."""
        ports.execute(self._resetting)
        self.rest(ports)
        self.armed = False

    def rest(self, ports: PortIO) -> None:
        """All lines low, then all outputs at 0 V, without petting."""
        ports.execute(self._resting)
        self.written_v[:] = [0.0] * OUTPUTS

    def arm(self, ports: PortIO) -> None:
        """Start the watchdog, anew if it runs or has expired."""
        if self._arming.size:
            ports.execute(self._arming)
        self.armed = True

    def write(self, ports: PortIO, voltage_v: list[float], lines: int) -> None:
        """Put out voltages (outputs,) [V] and the lines' register."""
        words = self._words
        for place, channel in self._places:
            words[place] = self.code(channel, voltage_v[channel])
            self.written_v[channel] = voltage_v[channel]
        words[self._line_place] = lines
        ports.execute(self._tick)

    def _build_tick(self, options: Sensoray526Options) -> None:
        batch = Batch(options.base)
        self._places = [(_add_staging(batch, channel, 0), channel) for channel in self._used]
        if self._used:
            batch.write(DAC_CONTROL, DAC_START)
        self._line_place = batch.write(DIGITAL, self._lines)
        for offset, word in pets(options):
            batch.write(offset, word)
        self._tick = batch.build()
        self._words = self._tick["value"]

    def _build_rest(self, options: Sensoray526Options) -> None:
        batch = Batch(options.base)
        batch.write(WATCHDOG, 0)
        batch.write(DIGITAL, self._lines)
        batch.write(DAC_CONTROL, DAC_RESET)
        batch.write(DAC_CONTROL, 0)
        self._resetting = batch.build()
        batch = Batch(options.base)
        batch.write(DIGITAL, self._lines)
        for channel in range(OUTPUTS):
            _add_staging(batch, channel, self.code(channel, 0.0))
        batch.write(DAC_CONTROL, DAC_START)
        self._resting = batch.build()


def _add_staging(batch: Batch, channel: int, code: int) -> int:
    batch.write(DAC_CONTROL, channel << 1)
    return batch.write(ANALOG_DATA, code)
