"""A linear amplifier with its motor's encoder, between an emulated analog card and the bench (07 section 2.1).

The card has to be emulated too, and made before: :meth:`set_encoder`, :meth:`set_index`, :meth:`set_line`, `output_v`,
`line_out` and `watchdog_expired` of the emulator of "sensoray526".
"""

import math
from collections.abc import Mapping
from typing import Any, cast

from hal.emulator import Bench, Station
from hal.errors import BackendError

QUADRATURE = 4
"""Counts a line: the card is to count every edge."""


class EmulatedLsc:
    """The electrical side of one axis.

    Faults: "not_ready" (the Ready wire is broken; the amplifier works on), "overheat" (the amplifier switches off and
    lets go of Ready), "encoder_cut" (no more edges), "encoder_inverted" (its channels are swapped), "command_open" (the
    set value's wire is broken, and the amplifier sees 0 V).
    """

    faults = ("not_ready", "overheat", "encoder_cut", "encoder_inverted", "command_open")
    apart = False

    def __init__(self, name: str, table: Mapping[str, Any], station: Station) -> None:
        if table["card"] not in station.emulators:
            raise BackendError(f"emulated {name} needs its card", value=table["card"], remedy="list the card before it")
        self._card = cast(Any, station.emulators[table["card"]])
        self._axis, self._counter, self._output = table["axis"], table["counter"], table["output"]
        self._enable, self._ready = table["enable_line"], table["ready_line"]
        turn = QUADRATURE * table["lines"] if "lines" in table else 0
        self._counts_per_rad = table.get("counts_per_rad") or turn * table.get("gear", 1.0) / math.tau
        self._counts_per_rad *= table.get("encoder_direction", 1)
        self._direction = table.get("command_direction", 1)
        self._broken = dict.fromkeys(self.faults, False)
        self._count, self._last = 0, 0
        if table.get("index", True):
            self._card.set_index(self._counter, turn)
        self._card.set_line(self._ready, False)

    def sense(self, tick: int, bench: Bench) -> None:  # noqa: ARG002
        """The encoder's edges since the last tick reach the counter; Ready is pulled low by a healthy amplifier."""
        now = math.floor(bench.angle_rad[self._axis] * self._counts_per_rad + 0.5)
        step, self._last = now - self._last, now
        if not self._broken["encoder_cut"]:
            self._count += -step if self._broken["encoder_inverted"] else step
        self._card.set_encoder(self._counter, self._count)
        self._card.set_line(self._ready, self._broken["not_ready"] or self._broken["overheat"])

    def drive(self, tick: int, bench: Bench) -> None:  # noqa: ARG002
        """The set value reaches the amplifier; Enable does unless the card's watchdog has opened the chain."""
        command_v = 0.0 if self._broken["command_open"] else self._card.output_v(self._output)
        bench.command_v[self._axis] = self._direction * command_v
        enabled = self._card.line_out(self._enable) and not self._card.watchdog_expired()
        bench.enabled[self._axis] = enabled and not self._broken["overheat"]

    def inject(self, fault: str, value: float = 1.0) -> None:
        """Break something; 0 mends it. Raises BackendError."""
        if fault not in self._broken:
            raise BackendError("no such fault of an emulated amplifier", value=fault, bound=" | ".join(self.faults))
        self._broken[fault] = value != 0
