"""An ATI stand-alone controller on a serial line: for the bench, too slow for control (07 section 3.5)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.ati.controller_line import ControllerLine
from drivers.ati.resolved import Resolved, Scale
from hal import options
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.frames import INVALID, VALID
from hal.options import option
from hal.seams import SerialLine
from hal.tally import Tally
from hal.troubles import Trouble


@dataclass(frozen=True, kw_only=True)
class SerialOptions(Resolved):
    """Settings of a device "ati_serial"."""

    path: str = option(doc="the serial port")
    baud: int = option(38400, low=1200, high=1000000, doc="as the controller is set")
    mode: str = option(
        "binary", choices=("binary", "ascii"), doc="records; a lost digit of an ASCII one cannot be noticed"
    )
    reply_s: float = option(0.04, low=0.005, high=1.0, unit="s", doc="without a complete reply for so long: start over")
    silent_ticks: int = option(100, low=5, high=1000, doc="oldest record that is still a wrench")


class AtiSerial:
    """The last record, as old as its request.

    A record is 6 ms old when it is complete (22 bytes at 38400 baud), and gets twice as old until the next one is.
    """

    options_type = SerialOptions
    axes: tuple[int, ...] = ()
    measures = frozenset({"wrench"})

    def __init__(self, name: str, table: Mapping[str, Any], site: Site) -> None:
        self.options = options.read(SerialOptions, table, f"device {name}")
        self.options.check(f"device {name}")
        self.name, self._site = name, site
        self._link: SerialLine | None = None
        self._line: ControllerLine | None = None
        self._restart()

    def _restart(self) -> None:
        self._scale, self._tally = Scale(self.options), Tally()
        self._sequence = self._error = self._tick = 0
        self._opened_tick = -1

    def open(self) -> None:
        """Open the port; the dialogue begins with the first tick. Raises BackendError."""
        self._restart()
        self._link = self._site.seams.serial(self.options.path, self.options.baud)
        self._line = ControllerLine(self._link, self.options.mode, self._site.period_s, self.options.reply_s)

    def begin(self, tick: int) -> None:
        """One request follows the other, whatever the tick is."""
        if self._opened_tick < 0:
            self._opened_tick = tick

    def read(self, tick: int, readings: Readings) -> None:
        """The last record's wrench, or why there is none."""
        self._tick, line = tick, self._line
        if line is None:
            return
        if line.turn(tick):
            self._error, self._sequence = line.record[0], self._sequence + 1
            if not self._error:
                self._scale.take(line.record[1:])
        validity = self._judge(tick, readings, line)
        readings.wrench_validity = validity
        if self._sequence:
            readings.wrench_sequence, readings.wrench_age_ticks = self._sequence, tick - line.asked_tick
        if validity == VALID:
            readings.wrench_in_sensor[:] = self._scale.wrench

    def _judge(self, tick: int, readings: Readings, line: ControllerLine) -> int:
        tally, limit = self._tally, self.options.silent_ticks
        silent = tick - max(line.heard_tick, self._opened_tick)
        if silent > limit:
            tally.report(tick, readings, Trouble.SENSOR_SILENT, silent)
        elif not line.in_step:
            tally.report(tick, readings, Trouble.LINE_DESYNC, line.desyncs)
        if not self._sequence or tick - line.asked_tick > limit:
            return INVALID
        if self._error:
            tally.report(tick, readings, Trouble.SENSOR_STATUS, self._error)
            return INVALID
        self._scale.report_load(tick, readings, tally)
        return VALID

    def write(self, tick: int, demand: Demand) -> None:
        """A sensor is not commanded."""

    def close(self) -> None:
        """Release the port; the controller falls silent by itself after the last record."""
        if self._link is not None:
            self._link.close()
        self._link = self._line = None

    def health(self) -> Health:
        """Where it is, and how often the dialogue was lost."""
        o, line = self.options, self._line
        identity = f"controller at {o.path}, {o.baud} baud, {o.mode}, {o.counts_per_force:g} counts/{o.force_unit}, {o.counts_per_torque:g} counts/{o.torque_unit}"
        age = self._tick - line.asked_tick if line is not None and self._sequence else NEVER
        return Health(identity, age_ticks=age, errors=dict(self._tally.errors))

    def probe(self) -> list[Finding]:
        """Whether it answers with records."""
        line = self._line
        good = line is not None and self._sequence > 0 and line.in_step
        return [
            Finding("records", "coming" if good else "none", good, f"check {self.options.path}, its wires and {self.options.baud} baud"),
            Finding("error number", str(self._error), not self._error, "look it up in the controller's manual"),
        ]  # fmt: skip
