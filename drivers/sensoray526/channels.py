"""Who uses which channel of a card, what was read on it, and what shall go out."""

import math

import numpy as np

from drivers.sensoray526.registers import COUNTERS, GROUP_OUTPUT, INPUTS, LINES, LINES_A_GROUP, OUTPUTS
from hal.errors import OptionError
from hal.frames import INVALID

LIMIT_V = 10.0


class Channels:
    """The part of :class:`hal.card.AnalogCard` that needs no hardware.

    The lines 0-3 and 4-7 have one direction each, so a group has either inputs or outputs.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.count = np.zeros(COUNTERS, np.int64)
        self.count_validity = np.full(COUNTERS, INVALID, np.uint8)
        self.count_sequence = 0
        self.count_error = np.zeros(COUNTERS, np.bool_)
        self.index_count = np.zeros(COUNTERS, np.int64)
        self.index_sequence = np.zeros(COUNTERS, np.int64)
        self.code = np.zeros(INPUTS, np.int32)
        self.voltage_v = np.full(INPUTS, np.nan)
        self.railed = np.zeros(INPUTS, np.bool_)
        self.voltage_validity, self.voltage_sequence = INVALID, 0
        self.line = np.zeros(LINES, np.bool_)
        self._users: dict[tuple[str, int], str] = {}
        self._group_outputs: dict[int, bool] = {}
        self._output_v = [0.0] * OUTPUTS
        self._shadow = 0

    def use_counter(self, channel: int, who: str) -> None:
        """See :class:`hal.card.AnalogCard`. Raises OptionError."""
        self._claim("counter", channel, COUNTERS, who)

    def use_input(self, channel: int, who: str) -> None:
        """See :class:`hal.card.AnalogCard`. Raises OptionError."""
        self._claim("input", channel, INPUTS, who)

    def use_output(self, channel: int, who: str) -> None:
        """See :class:`hal.card.AnalogCard`. Raises OptionError."""
        self._claim("output", channel, OUTPUTS, who)

    def use_line(self, number: int, who: str, *, output: bool) -> None:
        """See :class:`hal.card.AnalogCard`. Raises OptionError, also if the other direction is in use in its group."""
        self._claim("line", number, LINES, who)
        group = number // LINES_A_GROUP
        if self._group_outputs.setdefault(group, output) != output:
            wanted, first = ("output", "inputs") if output else ("input", "outputs")
            raise OptionError(f"{who} cannot have this line of {self.name} as an {wanted}", value=number, bound=f"lines {4 * group} .. {4 * group + 3} are {first} already", remedy="take one of the other four")  # fmt: skip
        if output:
            self._shadow |= GROUP_OUTPUT[group]

    def put_voltage(self, channel: int, voltage_v: float) -> None:
        """Stage a voltage [V], clamped to -10 .. 10; what is no number is 0 V."""
        if -LIMIT_V <= voltage_v <= LIMIT_V:
            self._output_v[channel] = voltage_v
        else:
            self._output_v[channel] = 0.0 if voltage_v != voltage_v else math.copysign(LIMIT_V, voltage_v)

    def put_line(self, number: int, high: bool) -> None:
        """Stage a level."""
        if high:
            self._shadow |= 1 << number
        else:
            self._shadow &= ~(1 << number)

    def used(self, what: str) -> list[int]:
        """Numbers of the claimed "counter"s, "input"s, "output"s or "line"s, in order."""
        return sorted(number for kind, number in self._users if kind == what)

    def _claim(self, what: str, number: int, how_many: int, who: str) -> None:
        if number not in range(how_many):
            raise OptionError(f"{who} wants a {what} that {self.name} does not have", value=number, bound=f"0 .. {how_many - 1}")  # fmt: skip
        owner = self._users.setdefault((what, number), who)
        if owner != who:
            raise OptionError(f"{who} wants a {what} of {self.name} that {owner} uses", value=number, remedy="check the wiring in the settings")  # fmt: skip

    def _rest(self) -> None:
        """Nothing is put: 0 V and low."""
        self._output_v[:] = [0.0] * OUTPUTS
        self._shadow &= ~0xFF

    def _forget(self) -> None:
        """Nothing that was read is to be used; lines read high, as an open cable does."""
        self.count_validity.fill(INVALID)
        self.count_error.fill(False)
        self._forget_voltages()
        self.line.fill(True)

    def _forget_voltages(self) -> None:
        self.voltage_validity = INVALID
        self.voltage_v.fill(math.nan)
        self.railed.fill(False)
