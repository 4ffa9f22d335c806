"""One axis of a Maxon LSC 30/2 or another linear amplifier on an analog card (07 sections 2.1, 2.2, 7).

The amplifier tells nothing but Ready, so the axis is watched from outside: by its encoder, and by a model of its heat.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from drivers.maxon_lsc import watch
from drivers.maxon_lsc.bounds import Bounds
from drivers.maxon_lsc.group import AxesOfCard
from drivers.maxon_lsc.options import GAINS, LscOptions
from drivers.maxon_lsc.state import axis_state
from hal import options
from hal.card import AnalogCard
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.errors import OptionError
from hal.frames import VALID
from hal.tally import Tally
from hal.troubles import Trouble

TROUBLES = {
    watch.JUMPED: Trouble.ENCODER_JUMP, watch.ILLEGAL: Trouble.ENCODER_ERROR, watch.STALLED: Trouble.ENCODER_STALLED,
    watch.INDEX_DRIFTS: Trouble.INDEX_DRIFT, watch.INDEX_LOST: Trouble.INDEX_LOST,
    watch.INDEX_MISSING: Trouble.INDEX_MISSING, watch.WRONG_WAY: Trouble.WRONG_WAY,
    watch.NOT_READY: Trouble.AMPLIFIER_NOT_READY, watch.HOT: Trouble.MOTOR_HOT,
}  # fmt: skip
COUNTS_TOLD = {watch.JUMPED: "jumped_by", watch.INDEX_DRIFTS: "index_off_by", watch.INDEX_LOST: "index_off_by"}
"""Troubles whose text names counts; the others name the axis."""


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
        self._card = card = site.find(o.card, AnalogCard, name)  # type: ignore[type-abstract]
        if o.enable_line == o.ready_line:
            raise OptionError(f"{where}: Enable and Ready cannot share a line", value=o.enable_line)
        card.use_counter(o.counter, name)
        card.use_output(o.output, name)
        card.use_line(o.enable_line, name, output=True)
        card.use_line(o.ready_line, name, output=False)
        self._bounds = Bounds(o)
        neighbours: list[Any] = [d for d in site.devices.values() if isinstance(d, LscAxis)]
        self.group: AxesOfCard = next((d.group for d in neighbours if d.group.card is card), None) or AxesOfCard(card)
        self._place = self.group.add(axis_state(o, site.period_s, where))
        self._tally = Tally()

    def open(self) -> None:
        """Angles count from the first sample after this; everything is compiled when it returns."""
        self.group.exercise()
        self.group.restart(self._place)
        self._tally = Tally()

    def begin(self, tick: int) -> None:
        """Nothing takes time: the card samples."""

    def read(self, tick: int, readings: Readings) -> None:
        """Angle, power and fault of the axis."""
        self.group.read(tick, readings)
        found = self.group.found.item(self._place)
        if found:
            self._report(tick, readings, found)

    def _report(self, tick: int, readings: Readings, found: int) -> None:
        for bit, trouble in TROUBLES.items():
            if found & bit:
                value = float(self._state[COUNTS_TOLD[bit]]) if bit in COUNTS_TOLD else self._axis
                self._tally.report(tick, readings, trouble, value)

    @property
    def _state(self) -> np.void:
        return self.group.state[self._place]

    def write(self, tick: int, demand: Demand) -> None:  # noqa: ARG002
        """Stage set value and Enable on the card."""
        group, place = self.group, self._place
        if not demand.power:
            group.held[place] = False
            self._put(0.0, False)
        elif group.held.item(place) or not group.ready.item(place):
            self._put(0.0, False)
        else:
            command_v, hot = demand.command_v.item(self._axis), group.found.item(place) & watch.HOT != 0
            if self._bounds.needs_speed:
                self._put(self._bounds.apply_at(command_v, hot, float(self._state["speed_rad_per_s"])), True)
            else:
                self._put(self._bounds.apply(command_v, hot), True)

    def _put(self, command_v: float, enabled: bool) -> None:
        group, place, o = self.group, self._place, self.options
        group.command_v[place] = command_v
        group.enabled[place] = enabled
        self._card.put_voltage(o.output, o.command_direction * command_v)
        self._card.put_line(o.enable_line, enabled)

    def close(self) -> None:
        """Stage zero; the card, which closes after this, passes it on."""
        self._put(0.0, False)

    def health(self) -> Health:
        """Where it is wired and what the amplifier is set to."""
        o = self.options
        gain = f"{GAINS[o.mode]} = {getattr(o, GAINS[o.mode]):g}"
        identity = f"axis {o.axis}: counter {o.counter}, output {o.output} of {o.card}; mode {o.mode}, {gain}"
        state = self._state
        age = int(state["tick"] - state["sampled"]) if state["sampled"] >= 0 else NEVER
        return Health(identity, age_ticks=age, errors=dict(self._tally.errors))

    def probe(self) -> list[Finding]:
        """The Ready line and the counter; polarities show only in motion, see docs/how-to/wire-lsc-amplifiers.md."""
        o, card = self.options, self._card
        ready, counts = not card.line.item(o.ready_line), card.count_validity.item(o.counter) == VALID
        angle = math.degrees(self._state["angle_rad"])
        return [
            Finding(f"Ready of axis {o.axis} on line {o.ready_line}", "low: ready" if ready else "high: fault, or open wire", ready, "check the amplifier's supply, the wire and its pull-up"),
            Finding(f"encoder of axis {o.axis} on counter {o.counter}", f"{angle:.2f} degrees since opened" if counts else "not read", counts, "check the card; then turn the shaft by hand and probe again"),
        ]  # fmt: skip
