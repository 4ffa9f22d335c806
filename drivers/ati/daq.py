"""An ATI transducer whose gauges are read by an analog card (07 sections 3.1 to 3.3, 7)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.ati import calibration
from drivers.ati.gauges import GAUGES, Gauges
from drivers.ati.mounting import Mounting
from drivers.tally import Tally
from hal import options
from hal.card import AnalogCard
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.errors import OptionError
from hal.frames import FROZEN, INVALID, SATURATED, VALID
from hal.options import option
from hal.troubles import Trouble

HIGH_PERCENT, RATED_PERCENT = 80.0, 100.0
T_OUT_V = (-1.6, -1.5)
"""Of a transducer without temperature compensation by a seventh channel."""
T_OUT_COMPENSATED_V = (0.5, math.inf)


@dataclass(frozen=True, kw_only=True)
class DaqOptions(Mounting):
    """Settings of a device "ati_daq"."""

    card: str = option(doc="name of the analog card it is wired to")
    inputs: tuple[float, ...] = option(shape=(GAUGES,), low=0, high=31, doc="the card's inputs of gauges 1 to 6")
    calibration: str = option(doc="path of the transducer's calibration file (.cal)")
    part: str = option("", doc="PartNumber of the calibration to use, if the file has several")
    t_out_input: int | None = option(
        None, low=0, high=31, doc="input of T-out: finds a cut cable, and serves the compensation of files that need it"
    )
    zero_v: tuple[float, ...] = option(
        (0.0,) * GAUGES, shape=(GAUGES,), low=-10, high=10, unit="V",
        doc="gauge voltages (compensated, where a file needs it) of the transducer bearing nothing; from the probe",
    )  # fmt: skip
    frozen_samples: int = option(
        20, low=2, high=10000, doc="identical words of one gauge in a row that are no accident"
    )
    noise_v: float = option(
        0.005, low=1e-5, high=1.0, unit="V", doc="rms of a gauge that calls for a look at its shield"
    )


class AtiDaq:
    """Six gauges of a card, made a wrench in {F} by the manufacturer's matrix.

    A saturated, frozen or unplugged transducer gives no number at all. The load is judged against the ratings of the
    file, in the transducer's own axes: it bears what is mounted on it too, so `zero_v` is the only zero that counts.
    """

    options_type = DaqOptions
    axes: tuple[int, ...] = ()
    measures = frozenset({"wrench"})

    def __init__(self, name: str, table: Mapping[str, Any], site: Site) -> None:
        where = f"device {name}"
        self.options = o = options.read(DaqOptions, table, where)
        self.calibration = c = calibration.load(Path(o.calibration), o.part)
        if c.thermistor_v is not None and o.t_out_input is None:
            raise OptionError(f"{where}: its calibration compensates temperature by a seventh channel", remedy="wire T-out and set t_out_input")  # fmt: skip
        if any(i != int(i) for i in o.inputs):
            raise OptionError(f"{where}.inputs must be whole numbers", value=o.inputs)
        self.name = name
        self._card = site.find(o.card, AnalogCard, name)  # type: ignore[type-abstract]
        self._inputs = np.array(o.inputs, np.intp)
        for channel in self._inputs.tolist():
            self._card.use_input(channel, name)
        if o.t_out_input is not None:
            self._card.use_input(o.t_out_input, name)
        self._zero_v = np.array(o.zero_v)
        self._to_wrench = np.ascontiguousarray(o.into_f @ c.matrix)
        self._to_percent = np.ascontiguousarray(100.0 * c.matrix / c.rated[:, None])
        self._gauge_v, self._wrench, self._percent = np.empty(GAUGES), np.empty(6), np.empty(6)
        self._restart()

    def _restart(self) -> None:
        self._gauges, self._tally = Gauges(self.options.frozen_samples, self.options.noise_v), Tally()
        self._sequence, self._sampled, self._tick = -1, -1, -1
        self._load, self._cable_off = math.nan, False

    def open(self) -> None:
        """The card is open already."""
        self._restart()

    def begin(self, tick: int) -> None:
        """The card scans."""

    def read(self, tick: int, readings: Readings) -> None:
        """The wrench, unless the card has none: then it says why."""
        card = self._card
        self._tick = tick
        if card.voltage_validity != VALID:
            return
        if card.voltage_sequence != self._sequence:
            self._sequence, self._sampled = card.voltage_sequence, tick
            self._sample()
        validity = self._judge(tick, readings)
        readings.wrench_validity = validity
        readings.wrench_sequence, readings.wrench_age_ticks = self._sequence, tick - self._sampled
        if validity == VALID:
            readings.wrench_in_sensor[:] = self._wrench

    def _sample(self) -> None:
        card, gauge_v, c = self._card, self._gauge_v, self.calibration
        card.voltage_v.take(self._inputs, out=gauge_v, mode="clip")
        railed = card.railed.take(self._inputs).tolist()
        self._gauges.take(card.code.take(self._inputs).tolist(), gauge_v.tolist(), railed)
        if self.options.t_out_input is not None:
            t_out_v = card.voltage_v.item(self.options.t_out_input)
            low, high = T_OUT_V if c.thermistor_v is None else T_OUT_COMPENSATED_V
            self._cable_off = not low <= t_out_v <= high or card.railed.item(self.options.t_out_input)
            if c.thermistor_v is not None and c.bias_slope is not None and c.gain_slope is not None:
                warmth_v = t_out_v - c.thermistor_v
                gauge_v += c.bias_slope * warmth_v
                gauge_v /= 1.0 - c.gain_slope * warmth_v
        gauge_v -= self._zero_v
        np.dot(self._to_wrench, gauge_v, out=self._wrench)
        np.dot(self._to_percent, gauge_v, out=self._percent)
        self._load = max(map(abs, self._percent.tolist()))

    def _judge(self, tick: int, readings: Readings) -> int:
        gauges, tally = self._gauges, self._tally
        if gauges.all_railed or self._cable_off:
            tally.report(tick, readings, Trouble.GAUGE_CABLE, math.nan)
            return SATURATED if gauges.railed else INVALID
        if gauges.railed:
            tally.report(tick, readings, Trouble.GAUGE_SATURATED, gauges.railed)
            return SATURATED
        if not gauges.settled:
            return SATURATED
        if gauges.frozen:
            tally.report(tick, readings, Trouble.GAUGE_FROZEN, gauges.frozen)
            return FROZEN
        if not math.isfinite(self._load):
            return INVALID
        if self._load >= RATED_PERCENT:
            tally.report(tick, readings, Trouble.LOAD_OVER_RATED, self._load)
        elif self._load >= HIGH_PERCENT:
            tally.report(tick, readings, Trouble.LOAD_HIGH, self._load)
        if gauges.noise_v > self.options.noise_v:
            tally.report(tick, readings, Trouble.GAUGE_NOISE, gauges.noise_v)
        return VALID

    def write(self, tick: int, demand: Demand) -> None:
        """A transducer is not commanded."""

    def close(self) -> None:
        """The card closes itself."""

    def health(self) -> Health:
        """Which transducer and which calibration."""
        age = self._tick - self._sampled if self._sampled >= 0 else NEVER
        return Health(self.calibration.identity, age_ticks=age, errors=dict(self._tally.errors))

    def probe(self) -> list[Finding]:
        """The gauges as they are: what `zero_v` is to be if the transducer bears nothing now."""
        gauges = self._gauges
        volts = " ".join(f"{v:.4f}" for v in (self._gauge_v + self._zero_v).tolist())
        sampled = self._sampled >= 0
        return [
            Finding("calibration", self.calibration.identity, True),
            Finding("gauge voltages", volts if sampled else "not read", sampled and not gauges.railed, "check the transducer's cable and the inputs' order"),
            Finding("transducer's cable", "off" if self._cable_off or gauges.all_railed else "on", not (self._cable_off or gauges.all_railed), "plug it in; check T-out"),
            Finding("load in per cent of rated", f"{self._load:.0f}", self._load < HIGH_PERCENT, "unload it, then set zero_v to the gauge voltages"),
            Finding("noise", f"{1e3 * gauges.noise_v:.2f} mV rms", gauges.noise_v <= self.options.noise_v, "check shield and ground"),
        ]  # fmt: skip
