"""What an analog card offers to the devices wired to it: counters, voltages in and out, digital lines."""

from typing import Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class AnalogCard(Protocol):
    """A card of counters, converters and lines; a device before those that use it.

    Channels are claimed once, when the devices are made; a claim that does not fit raises OptionError. What was read is
    valid from the card's `read` to its next `begin`; what is put goes out, all at once, in the card's `write`.

    Attributes:
        count (counters,) i8: accumulated since open, wrap-around undone.
        count_validity (counters,) u1, count_sequence: the samples of this tick.
        count_error (counters,) bool: the counter saw an illegal step since the last read.
        index_count (counters,) i8: accumulated count latched at the last index pulse; index_sequence (counters,) how many.
        code (inputs,) i4: words of the converter, before any calibration. References that are converted with every scan
            make the voltage of a frozen channel dither: only its word stands still.
        voltage_v (inputs,): calibrated, NaN unless claimed and valid.
        railed (inputs,) bool: within 0.5 % of full scale.
        voltage_validity, voltage_sequence: of the whole scan.
        line (lines,) bool: levels read.
    """

    name: str
    count: np.ndarray
    count_validity: np.ndarray
    count_sequence: int
    count_error: np.ndarray
    index_count: np.ndarray
    index_sequence: np.ndarray
    code: np.ndarray
    voltage_v: np.ndarray
    railed: np.ndarray
    voltage_validity: int
    voltage_sequence: int
    line: np.ndarray

    def use_counter(self, channel: int, who: str) -> None:
        """Claim a quadrature counter (x4, index latching)."""

    def use_input(self, channel: int, who: str) -> None:
        """Claim a differential input; it is part of every scan."""

    def use_output(self, channel: int, who: str) -> None:
        """Claim an analog output; 0 V until something is put."""

    def use_line(self, number: int, who: str, *, output: bool) -> None:
        """Claim a digital line; an output is low until something is put."""

    def put_voltage(self, channel: int, voltage_v: float) -> None:
        """Stage a finite voltage, clamped to -10 .. 10 V."""

    def put_line(self, number: int, high: bool) -> None:
        """Stage a level."""
