"""An emulated Sensoray 526: registers for the driver on one side, terminals for the other emulators on the other."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hal.emulator import Bench, Station
from hal.errors import BackendError
from hal.seams import OPERATION
from sim_backends.emulators import sensoray526_counters as counters
from sim_backends.emulators import sensoray526_registers as registers
from sim_backends.emulators.sensoray526_card import CARD, make_card

MISUSE = {
    registers.OUTSIDE: "a port outside the card was accessed",
    registers.ODD: "an odd port was accessed: the card has 16-bit registers at even ones",
    registers.NO_REGISTER: "there is no such register",
    registers.NOT_MODELLED: "a driver of this card has no reason to do this",
}
GLITCH_COUNTS = 5000
CHANNEL_FAULTS = {
    "stale_channel": "stale_channel",
    "input_rail": "railed_input",
    "encoder_freeze": "frozen_counter",
    "encoder_drop": "dropping_counter",
    "index_suppress": "silent_index",
    "dac_freeze": "frozen_output",
}


class CardPorts:
    """See :class:`hal.seams.PortIO`: batches on the registers of a card, wherever its record lies.

    Args:
        record: (1,) of CARD, possibly in memory shared with the process that has the emulator.
    """

    def __init__(self, record: np.ndarray) -> None:
        if record.dtype != CARD or record.shape != (1,):
            raise TypeError("a card is one record of CARD")
        self._record = record
        self._where = np.zeros(1, np.int32)

    def execute(self, operations: np.ndarray) -> int:
        """See :class:`hal.seams.PortIO`. Raises BackendError if the driver misuses the card."""
        if operations.dtype != OPERATION:
            raise TypeError("operations must be of hal.seams.OPERATION")
        outcome = registers.execute(self._record, operations.view(np.int32).reshape(-1, 6), self._where)
        if outcome >= 0:
            return outcome
        number = int(self._where[0])
        raise BackendError(MISUSE[outcome], value=f"operation {number}: {operations[number]}", remedy="mend the driver")

    def close(self) -> None:
        """The card stays as it is: its outputs hold."""


class EmulatedSensoray526:
    """See :class:`hal.emulator.Emulator`. Its own power-on state, not what the driver made of it, is the start.

    Faults of a channel are injected with 1 + its number, so that 0 mends: stale_channel (not converted any more),
    input_rail (+12 V), encoder_freeze (no edge comes), encoder_drop (one edge in ten is lost), encoder_glitch (jumps once
    by 5000 counts), ecap (illegal steps), index_suppress, index_add (one pulse at this place), dac_freeze. The others:
    signature (what is read, 65535 for no card), adc_never_done, reference_drift (relative error of the +10 V),
    reference_offset (codes), preset_near_wrap (counts before the wrap that a load gives), eeprom_corrupt, stop_petting
    (the driver is dead, as the card sees it).

    Attributes:
        record: the card (1,) of CARD; times, noise and calibration can be changed in it.
    """

    faults = (
        *CHANNEL_FAULTS, "encoder_glitch", "ecap", "index_add", "signature", "adc_never_done", "reference_drift",
        "reference_offset", "preset_near_wrap", "eeprom_corrupt", "stop_petting",
    )  # fmt: skip
    apart = False

    def __init__(self, name: str, table: Mapping[str, Any], station: Station) -> None:
        self.name, base = name, int(table.get("base", 0x2C0))
        self._loop_back = tuple(int(n) for n in table.get("loop_back", ()))
        self._watchdog_line = int(table.get("watchdog_line", -1))
        self.record = station.card_memory(base, CARD)
        self.record[:] = make_card(base, station.seed)
        self.record["watchdog_ticks"] = max(1, round(float(table.get("watchdog_interval_s", 0.1)) / station.period_s))
        self._healthy = self.record.copy()
        self._ecap = -1
        self._tick: int | None = None
        station.switchboard.plug_ports(base, CardPorts(self.record))
        for channel in range(len(self.record["shaft"][0])):
            self.set_encoder(channel, 0)
        registers.tick(self.record, 0)

    def sense(self, tick: int, bench: Bench) -> None:  # noqa: ARG002
        """Ticks pass: what was started is done, the watchdog counts, wires back to the card follow."""
        passed = 1 if self._tick is None else max(0, tick - self._tick)
        self._tick = tick
        registers.tick(self.record, passed)
        if self._ecap >= 0:
            self.record["events"][0, self._ecap] |= counters.ERROR
        if self._watchdog_line >= 0:
            self.set_line(self._watchdog_line, self.watchdog_expired())
        if self._loop_back:
            output, back = self._loop_back
            self.set_input(back, self.output_v(output))

    def drive(self, tick: int, bench: Bench) -> None:
        """Nothing: who is wired to the outputs looks at them."""

    def set_encoder(self, channel: int, count: int) -> None:
        """The encoder at a counter stands at `count` quarter lines since power-on."""
        counters.turn_to(self.record, channel, count)

    def set_index(self, channel: int, counts_per_turn: int) -> None:
        """That encoder has an index, on every multiple of `counts_per_turn` quarter lines."""
        self.record["turn"][0, channel] = counts_per_turn
        self.record["index_level"][0, channel] = self.record["shaft"][0, channel] % counts_per_turn == 0

    def set_input(self, channel: int, voltage_v: float) -> None:
        """Voltage between the terminals of a differential input [V]."""
        self.record["input_v"][0, channel] = voltage_v

    def output_v(self, channel: int) -> float:
        """What the terminal of an analog output really carries [V]."""
        card = self.record[0]
        return float((card["code"][channel] - card["dac_offset"][channel]) / card["dac_gain"][channel])

    def set_line(self, number: int, high: bool) -> None:
        """Level that is applied to a line; what the card drives itself wins."""
        self.record["line_in"][0, number] = high

    def line_out(self, number: int) -> bool:
        """Whether the card drives a line high."""
        word = int(self.record["digital"][0])
        return bool(word & (0x0400 if number < 4 else 0x0800)) and bool(word >> number & 1)

    def watchdog_expired(self) -> bool:
        """Nobody petted the watchdog for its interval: the enable chain is open."""
        return bool(self.record["watchdog_expired"][0])

    def inject(self, fault: str, value: float = 1.0) -> None:
        """Break something, see the class; 0 mends it. Raises BackendError for a fault that is not known."""
        if fault in CHANNEL_FAULTS:
            self.record[CHANNEL_FAULTS[fault]] = int(value) - 1
        elif fault in self.faults:
            special: dict[str, Callable[[float], None]] = {
                "encoder_glitch": self._glitch, "ecap": self._capture, "index_add": self._add_index,
                "signature": self._sign, "adc_never_done": self._set("adc_never_done"), "reference_drift": self._drift,
                "reference_offset": self._offset, "preset_near_wrap": self._preset, "eeprom_corrupt": self._corrupt,
                "stop_petting": self._set("deaf_watchdog"),
            }  # fmt: skip
            special[fault](value)
        else:
            raise BackendError("this emulator does not know the fault", value=fault, bound=" | ".join(self.faults))

    def _set(self, field: str) -> Callable[[float], None]:
        def put(value: float) -> None:
            self.record[field] = value != 0

        return put

    def _glitch(self, value: float) -> None:
        if value:
            counters.jump(self.record, int(value) - 1, GLITCH_COUNTS)

    def _capture(self, value: float) -> None:
        self._ecap = int(value) - 1
        if value:
            self.record["events"][0, self._ecap] |= counters.ERROR

    def _add_index(self, value: float) -> None:
        if value:
            counters.pulse(self.record, int(value) - 1)

    def _sign(self, value: float) -> None:
        self.record["signature"] = int(value) or self._healthy["signature"]

    def _drift(self, value: float) -> None:
        self.record["reference_v"] = self._healthy["reference_v"] * (1.0 + value)

    def _offset(self, value: float) -> None:
        self.record["adc_offset"] = self._healthy["adc_offset"] + value

    def _preset(self, value: float) -> None:
        self.record["load_at"] = 0x7FFFFF - int(value) if value else -1

    def _corrupt(self, value: float) -> None:
        self.record["eeprom"] = self._healthy["eeprom"]
        if value:
            self.record["eeprom"][0, 3] ^= 0x0040  # an exponent bit of the gain of output 0
