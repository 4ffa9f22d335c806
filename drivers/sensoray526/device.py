"""The device "sensoray526": a card of counters, converters and lines for the devices wired to it (07 section 1).

A tick has three batches of port accesses. The first starts the converter and reads the counters and lines meanwhile, the
second waits for the converter, within a bound, and collects; the third moves all outputs at once and pets the watchdog.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drivers.sensoray526 import counters, probing, scan
from drivers.sensoray526.batches import ReadingBatches
from drivers.sensoray526.channels import Channels
from drivers.sensoray526.eeprom import Calibration, read_calibration
from drivers.sensoray526.options import Sensoray526Options, read_options
from drivers.sensoray526.output import Outputs
from drivers.sensoray526.registers import LINES, SIGNATURE, SIGNATURES, SIZE, Batch
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.errors import BackendError, OptionError
from hal.frames import VALID
from hal.seams import PortIO
from hal.troubles import Trouble

GIVE_UP_TICKS = 3
LEVELS = (np.arange(1 << LINES)[:, None] >> np.arange(LINES) & 1).astype(np.bool_)
"""Levels of the lines (256, lines) for every word they can be read as."""


class Sensoray526(Channels):
    """One card; a :class:`hal.device.Device` and a :class:`hal.card.AnalogCard`.

    A card that once did not show its signature stays INVALID until it is opened anew: its counters may have restarted.
    """

    options_type = Sensoray526Options
    axes: tuple[int, ...] = ()
    measures: frozenset[str] = frozenset()

    def __init__(self, name: str, table: Mapping[str, Any], site: Site) -> None:
        super().__init__(name)
        self.options = o = read_options(table, f"device {name}", site.period_s)
        for other in site.devices.values():
            if isinstance(other, Sensoray526) and other.options.base == o.base:
                raise OptionError(f"two cards at one address: {other.name} and {name}", value=hex(o.base), remedy="set other jumpers and base")  # fmt: skip
        if o.loop_back:
            self.use_input(int(o.loop_back[1]), f"{name}.loop_back")
        if o.watchdog_line >= 0:
            self.use_line(o.watchdog_line, f"{name}.watchdog_line", output=False)
        self._site = site
        self._ports: PortIO | None = None
        self.signature, self.calibration = 0, Calibration((), (), np.nan)
        self.errors = dict.fromkeys(("signature", "adc_not_done", "adc_reference", "count_error", "index_missed", "dac_mismatch"), 0)  # fmt: skip
        self._tick = self._good_tick = -NEVER

    def open(self) -> None:
        """Check signature, calibration and converter; outputs at 0 V and low. Raises BackendError."""
        o = self.options
        ports = self._site.seams.ports(o.base, SIZE)
        try:
            self._check_signature(ports)
            self.calibration = read_calibration(ports, o.base)
            self._rest()
            self._outputs = Outputs(o, self.calibration, self.used("output"), self._shadow)
            self._outputs.reset(ports)
            self._prepare(ports)
            self._ports = ports
            self._try_a_tick()
        except BaseException:
            self._ports = None
            ports.close()
            raise

    def begin(self, tick: int) -> None:
        """Start the scan; read counters and lines while it converts."""
        self._tick = tick
        if self._ports is not None and not self._lost:
            self._ports.execute(self._batches.first)

    def read(self, tick: int, readings: Readings) -> None:
        """Collect the scan and take over what the card showed."""
        if self._ports is None:
            return
        shown = int(self._batches.first_words[0])
        if self._lost or shown not in SIGNATURES:
            self._lose(shown, readings)
            return
        self._good_tick = tick
        self._take_counts()
        self.line[:] = LEVELS[int(self._batches.first_words[-1]) & 0xFF]
        second = self._batches.second
        timed_out = self._ports.execute(second) if second.size else 0
        if self._inputs.size:
            self._take_voltages(timed_out, readings)
        o = self.options
        readings.watchdog_tripped |= self._outputs.armed and o.watchdog_line >= 0 and bool(self.line[o.watchdog_line])

    def write(self, tick: int, demand: Demand) -> None:  # noqa: ARG002
        """Put out what was staged, all at once. Arms the watchdog the first time, and anew with ``clear_faults``."""
        if self._ports is not None:
            if demand.clear_faults or not self._outputs.armed:
                self._outputs.arm(self._ports)
            self._outputs.write(self._ports, self._output_v, self._shadow)

    def close(self) -> None:
        """0 V, lines low; nobody pets the watchdog any more."""
        ports, self._ports = self._ports, None
        if ports is not None:
            self._rest()
            self._outputs.rest(ports)
            ports.close()
            self._forget()

    def health(self) -> Health:
        """Signature and calibration; ticks since the signature was seen."""
        c = self.calibration
        gains = ", ".join(f"{gain:.2f}·V + {offset:.1f}" for gain, offset in zip(c.gain, c.offset, strict=True))
        identity = f"{self.signature:04X} at {self.options.base:#x}; reference {c.reference_v:.5f} V; outputs {gains}"
        age = self._tick - self._good_tick if self._good_tick >= 0 else NEVER
        return Health(identity, age_ticks=age, errors=dict(self.errors))

    def probe(self) -> list[Finding]:
        """Look at everything that can be seen without moving anything. Raises BackendError if the card is not open."""
        if self._ports is None:
            raise BackendError("the card is not open", value=self.name)
        return probing.probe(self, self._ports)

    def scan_words(self) -> np.ndarray:
        """Results (2 + inputs,) of the latest scan: +10 V, 0 V, then the claimed inputs."""
        return self._batches.scan_words

    def _check_signature(self, ports: PortIO) -> None:
        batch = Batch(self.options.base)
        batch.read(SIGNATURE)
        look = batch.build()
        ports.execute(look)
        self.signature = int(look["result"][0])
        if self.signature not in SIGNATURES:
            raise BackendError(f"no card at {self.options.base:#x}: its signature is wrong", value=f"{self.signature & 0xFFFF:04X}", bound="526A | 526B", remedy="check its seat, the jumpers J1 and base")  # fmt: skip

    def _prepare(self, ports: PortIO) -> None:
        """Set the counters up and build the batches of a tick."""
        o = self.options
        flag, latch_at = counters.index_event(o.index_edge)
        self._index_flag, self._control = (flag, latch_at) if o.index else (0, 0)
        used, inputs = self.used("counter"), self.used("input")
        setup = Batch(o.base)
        for channel in used:
            counters.add_setup(setup, channel, index=o.index, latch_at=latch_at)
        if used:
            ports.execute(setup.build())
        self._raw = np.zeros(len(self.count), np.int64)
        self.count.fill(0)
        self.index_count.fill(0)
        self.index_sequence.fill(0)
        self._channels, self._inputs = np.array(used, np.int64), np.array(inputs, np.int64)
        self._batches = ReadingBatches(o, used, inputs, self._control)
        self._lost, self._unfinished, self._fresh = False, 0, True

    def _try_a_tick(self) -> None:
        """Everything a tick needs has run once when it comes to it; counts begin at zero."""
        readings = Readings(0)
        self.begin(0)
        self.read(0, readings)
        if readings.trouble == Trouble.ADC_NOT_DONE:
            raise BackendError("the card's converter does not finish", value=f"{self.options.poll_limit} polls", remedy="raise poll_limit, or replace the card")  # fmt: skip

    def _lose(self, shown: int, readings: Readings) -> None:
        self._lost = True
        self.errors["signature"] += 1
        self._forget()
        readings.report(Trouble.CARD_LOST, shown & 0xFFFF)

    def _take_counts(self) -> None:
        if not self._channels.size:
            return
        batches = self._batches
        wrong, missed = counters.decode(
            batches.count_words, self._channels, self._index_flag, self._control, self._raw, self.count, self.count_error,
            self.index_count, self.index_sequence, batches.clear_words,
        )  # fmt: skip
        if self._fresh:
            self.count.fill(0)
            self._fresh = False
        self.errors["count_error"] += wrong
        self.errors["index_missed"] += missed
        self.count_validity[self._channels] = VALID
        self.count_sequence += 1

    def _take_voltages(self, timed_out: int, readings: Readings) -> None:
        if timed_out:
            self._unfinished += 1
            self.errors["adc_not_done"] += 1
            self._forget_voltages()
            grave = self._unfinished >= GIVE_UP_TICKS
            readings.report(Trouble.ADC_STOPPED if grave else Trouble.ADC_NOT_DONE, self._unfinished)
            return
        self._unfinished = 0
        off = scan.decode(
            self._batches.scan_words, self._inputs, self.calibration.reference_v, self.code, self.voltage_v, self.railed
        )
        if off:
            self.errors["adc_reference"] += 1
            self._forget_voltages()
            readings.report(Trouble.ADC_REFERENCE, off)
            return
        self.voltage_validity = VALID
        self.voltage_sequence += 1
        if self.options.loop_back:
            self._compare_loop_back(readings)

    def _compare_loop_back(self, readings: Readings) -> None:
        output, back = self.options.loop_back
        off = float(self.voltage_v[int(back)]) - self._outputs.written_v[int(output)]
        if not abs(off) <= self.options.loop_back_tolerance_v:
            self.errors["dac_mismatch"] += 1
            readings.report(Trouble.DAC_MISMATCH, off)
