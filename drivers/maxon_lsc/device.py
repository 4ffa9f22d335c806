"""One axis of a Maxon LSC 30/2 or another linear amplifier on an analog card (07 sections 2.1, 2.2, 7).

The amplifier tells nothing but Ready, so the axis is watched from outside: by its encoder, and by a model of its heat.
"""

import math
from collections.abc import Mapping
from typing import Any

from drivers.maxon_lsc.encoder import DRIFT_COUNTS, LOST_COUNTS, Encoder, Index, Stall, WrongWay
from drivers.maxon_lsc.motor import Motor
from drivers.maxon_lsc.options import GAINS, LscOptions
from drivers.tally import Tally
from hal import options
from hal.card import AnalogCard
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.errors import OptionError
from hal.frames import VALID
from hal.troubles import Trouble

DEBOUNCE = 2
"""Reads in a row that make a change of the Ready line (07 section 7)."""


class LscAxis:
    """Encoder, set value, Enable and Ready of one motor.

    A fault of the amplifier drops Enable and the set value at once, and both stay down until a command without power.
    A count that jumped, or that the counter calls wrong, is INVALID in that tick; what follows is measured from there.
    """

    options_type = LscOptions
    measures: frozenset[str] = frozenset()

    def __init__(self, name: str, table: Mapping[str, Any], site: Site) -> None:
        where = f"device {name}"
        self.options = o = options.read(LscOptions, table, where)
        o.check(where)
        self.name, self.axes, self._axis = name, (o.axis,), o.axis
        self._period_s = site.period_s
        self._card = card = site.find(o.card, AnalogCard, name)  # type: ignore[type-abstract]
        if o.enable_line == o.ready_line:
            raise OptionError(f"{where}: Enable and Ready cannot share a line", value=o.enable_line)
        card.use_counter(o.counter, name)
        card.use_output(o.output, name)
        card.use_line(o.enable_line, name, output=True)
        card.use_line(o.ready_line, name, output=False)
        self._restart()

    def _restart(self) -> None:
        o = self.options
        self._encoder, self._motor = Encoder(o, self._period_s), Motor(o, self._period_s)
        self._index = Index(o)
        self._stall = Stall(max(round(o.stall_s / self._period_s), 1))
        self._wrong_way = WrongWay(round(o.wrong_way_s / self._period_s))
        self._tally = Tally()
        self._sequence, self._sampled, self._tick = -1, -1, -1
        self._ready, self._fault, self._high, self._low = False, False, 0, 0
        self._held = self._enabled = self._jumped = False
        self._command_v = 0.0

    def open(self) -> None:
        """Angles count from the first sample after this."""
        self._restart()

    def begin(self, tick: int) -> None:
        """Nothing takes time: the card samples."""

    def read(self, tick: int, readings: Readings) -> None:
        """Angle, power and fault of the axis."""
        axis, tally = self._axis, self._tally
        ticks = max(tick - self._tick, 1) if self._tick >= 0 else 1
        self._tick = tick
        self._motor.pass_ticks(ticks, self._command_v, self._encoder.speed_rad_per_s, self._enabled)
        if self._motor.hot:
            tally.report(tick, readings, Trouble.MOTOR_HOT, axis)
        if self._watch_ready():
            tally.report(tick, readings, Trouble.AMPLIFIER_NOT_READY, axis)
        readings.axis_fault[axis] = self._fault
        readings.axis_powered[axis] = self._enabled and not self._held
        self._read_count(tick, readings)
        if self._index.off_by:
            off = abs(self._index.off_by)
            if off > LOST_COUNTS:
                tally.report(tick, readings, Trouble.INDEX_LOST, self._index.off_by)
            elif off > DRIFT_COUNTS:
                tally.report(tick, readings, Trouble.INDEX_DRIFT, self._index.off_by)

    def _watch_ready(self) -> bool:
        """True while Ready is open: the amplifier pulls it low as long as it is healthy, so a cut wire is a fault too."""
        if self._card.line.item(self.options.ready_line):
            self._high, self._low = self._high + 1, 0
        else:
            self._high, self._low = 0, self._low + 1
        if self._high >= DEBOUNCE:
            self._fault, self._ready = True, False
            self._held = self._held or self._enabled
        elif self._low >= DEBOUNCE:
            self._fault, self._ready = False, True
        return self._fault

    def _read_count(self, tick: int, readings: Readings) -> None:
        card, o, axis, encoder, tally = self._card, self.options, self._axis, self._encoder, self._tally
        if card.count_validity.item(o.counter) != VALID:
            self._wrong_way.restart()
            return
        wrong = False
        if card.count_sequence != self._sequence:
            ticks = max(tick - self._sampled, 1) if self._sampled >= 0 else 1
            self._sequence, self._sampled = card.count_sequence, tick
            count = card.count.item(o.counter)
            encoder.take(count, ticks)
            self._jumped = encoder.jumped_by != 0
            if o.index:
                self._index.take(card.index_sequence.item(o.counter), card.index_count.item(o.counter))
            if self._jumped:
                tally.report(tick, readings, Trouble.ENCODER_JUMP, encoder.jumped_by)
            if card.count_error.item(o.counter):
                tally.report(tick, readings, Trouble.ENCODER_ERROR, axis)
                wrong = True
            self._watch_motion(tick, readings, o.encoder_direction * count, ticks)
        if not (wrong or self._jumped):
            readings.axis_validity[axis] = VALID
            readings.axis_angle_rad[axis] = encoder.angle_rad
            readings.axis_sequence[axis] = self._sequence
            readings.axis_age_ticks[axis] = tick - self._sampled

    def _watch_motion(self, tick: int, readings: Readings, count: int, ticks: int) -> None:
        push = 0
        if self._enabled and abs(self._command_v) > self.options.breakaway_v:
            push = 1 if self._command_v > 0.0 else -1
        if self._stall.take(count, push, ticks):
            self._tally.report(tick, readings, Trouble.ENCODER_STALLED, self._axis)
        if ticks > 1 or self._jumped:
            self._wrong_way.restart()
        elif self._wrong_way.take(count, push):
            self._tally.report(tick, readings, Trouble.WRONG_WAY, self._axis)

    def write(self, tick: int, demand: Demand) -> None:  # noqa: ARG002
        """Stage set value and Enable on the card."""
        if not demand.power:
            self._held = False
        self._enabled = demand.power and self._ready and not self._held
        command_v = demand.command_v.item(self._axis) if self._enabled else 0.0
        self._put(self._motor.bound_v(command_v, self._encoder.speed_rad_per_s))

    def _put(self, command_v: float) -> None:
        o = self.options
        self._command_v = command_v
        self._card.put_voltage(o.output, o.command_direction * command_v)
        self._card.put_line(o.enable_line, self._enabled)

    def close(self) -> None:
        """Stage zero; the card, which closes after this, passes it on."""
        self._enabled = False
        self._put(0.0)

    def health(self) -> Health:
        """Where it is wired and what the amplifier is set to."""
        o = self.options
        gain = f"{GAINS[o.mode]} = {getattr(o, GAINS[o.mode]):g}"
        identity = f"axis {o.axis}: counter {o.counter}, output {o.output} of {o.card}; mode {o.mode}, {gain}"
        age = self._tick - self._sampled if self._sampled >= 0 else NEVER
        return Health(identity, age_ticks=age, errors=dict(self._tally.errors))

    def probe(self) -> list[Finding]:
        """The Ready line and the counter; polarities show only in motion, see docs/how-to/wire-lsc-amplifiers.md."""
        o, card = self.options, self._card
        ready, counts = not card.line.item(o.ready_line), card.count_validity.item(o.counter) == VALID
        angle = math.degrees(self._encoder.angle_rad)
        return [
            Finding(f"Ready of axis {o.axis} on line {o.ready_line}", "low: ready" if ready else "high: fault, or open wire", ready, "check the amplifier's supply, the wire and its pull-up"),
            Finding(f"encoder of axis {o.axis} on counter {o.counter}", f"{angle:.2f} degrees since opened" if counts else "not read", counts, "check the card; then turn the shaft by hand and probe again"),
        ]  # fmt: skip
