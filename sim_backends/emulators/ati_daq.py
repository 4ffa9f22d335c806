"""An ATI transducer on an emulated analog card (07 sections 3.1 to 3.3)."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from hal.emulator import Bench, Station
from hal.errors import BackendError
from sim_backends.emulators.transducer import Bridge, out_of_f

RAIL_V = 12.0
"""Where the amplifiers end, beyond what a card can read."""
T_OUT_V = -1.55
"""Of a transducer without the temperature option."""


class EmulatedAtiDaq:
    """Six noisy gauge voltages, and T-out where it is wired.

    Faults: "gauge_rail" and "gauge_freeze" (value: the gauge, 1 .. 6), "cable_off", "drift" (V/s at every gauge), "noise"
    (factor on the dither), "overload" (share of the rated Fz that is added to the load).

    Attributes:
        dither_v (6,): rms of the gauges' noise; 0 makes a healthy gauge look frozen.
        t_out_v: temperature, as the transducer tells it.
    """

    faults = ("gauge_rail", "cable_off", "gauge_freeze", "drift", "noise", "overload")
    apart = False

    def __init__(self, name: str, table: Mapping[str, Any], station: Station) -> None:
        if table["card"] not in station.emulators:
            raise BackendError(f"emulated {name} needs its card", value=table["card"], remedy="list the card before it")
        self._card = cast(Any, station.emulators[table["card"]])
        self._out_of_f, self._inputs, self._t_out = (
            out_of_f(table),
            [int(i) for i in table["inputs"]],
            table.get("t_out_input"),
        )
        self._bridge = Bridge(table["calibration"], table.get("part", ""))
        compensated = self._bridge.reference_v == self._bridge.reference_v
        self.t_out_v = self._bridge.reference_v if compensated else T_OUT_V
        self.dither_v = np.full(6, 0.0012)
        self._zero_v, self._period_s = np.array(table.get("zero_v", (0.0,) * 6)), station.period_s
        self._random = np.random.default_rng([station.seed, sum(name.encode())])
        self._level = dict.fromkeys(self.faults, 0.0)
        self._gauge_v = np.zeros(6)

    def sense(self, tick: int, bench: Bench) -> None:  # noqa: ARG002
        """The gauges follow the load."""
        level = self._level
        load = self._out_of_f @ bench.wrench_in_sensor
        load[2] += level["overload"] * self._bridge.rated[2]
        self._zero_v += level["drift"] * self._period_s
        gauge_v = self._bridge.gauge_v(load, self._zero_v, self.t_out_v)
        gauge_v += self.dither_v * (level["noise"] or 1.0) * self._random.standard_normal(6)
        if level["gauge_freeze"]:
            frozen = int(level["gauge_freeze"]) - 1
            gauge_v[frozen] = self._gauge_v[frozen]
        self._gauge_v = gauge_v.copy()
        if level["gauge_rail"]:
            gauge_v[int(level["gauge_rail"]) - 1] = RAIL_V
        if level["cable_off"]:
            gauge_v[:] = RAIL_V
        for channel, volts in zip(self._inputs, gauge_v.tolist(), strict=True):
            self._card.set_input(channel, min(max(volts, -RAIL_V), RAIL_V))
        if self._t_out is not None:
            self._card.set_input(self._t_out, 0.0 if level["cable_off"] else self.t_out_v)

    def drive(self, tick: int, bench: Bench) -> None:
        """A transducer only measures."""

    def inject(self, fault: str, value: float = 1.0) -> None:
        """Break something; 0 mends it. Raises BackendError."""
        if fault not in self._level:
            raise BackendError("no such fault of an emulated transducer", value=fault, bound=" | ".join(self.faults))
        if fault in ("gauge_rail", "gauge_freeze") and value not in range(7):
            raise BackendError("no such gauge", value=value, bound="1 .. 6, 0 mends")
        self._level[fault] = value
