"""An ATI transducer whose gauges are read by an analog card (07 sections 3.1 to 3.3, 7)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.ati import calibration, gauges
from drivers.ati.gauges import GAUGES, HIGH_PERCENT, TRANSDUCER
from drivers.ati.mounting import Mounting
from hal import options
from hal.card import AnalogCard
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.errors import OptionError
from hal.files import find
from hal.frames import INVALID, VALID
from hal.options import option
from hal.tally import Tally
from hal.troubles import Trouble

T_OUT_V = (-1.6, -1.5)
"""Of a transducer without temperature compensation by a seventh channel."""
T_OUT_COMPENSATED_V = (0.5, math.inf)
TROUBLES = {
    gauges.CABLE: (Trouble.GAUGE_CABLE, "railed"), gauges.RAILED: (Trouble.GAUGE_SATURATED, "railed"),
    gauges.STUCK: (Trouble.GAUGE_FROZEN, "stuck"), gauges.NOISY: (Trouble.GAUGE_NOISE, "noise_v"),
    gauges.HIGH: (Trouble.LOAD_HIGH, "load_percent"), gauges.OVER_RATED: (Trouble.LOAD_OVER_RATED, "load_percent"),
}  # fmt: skip
"""What a bit means, and where the number of its text is."""


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
        self.calibration = c = calibration.load(find(o.calibration), o.part)
        if c.thermistor_v is not None and o.t_out_input is None:
            raise OptionError(f"{where}: its calibration compensates temperature by a seventh channel", remedy="wire T-out and set t_out_input")  # fmt: skip
        if any(i != int(i) for i in o.inputs):
            raise OptionError(f"{where}.inputs must be whole numbers", value=o.inputs)
        channels = [*o.inputs, *([] if o.t_out_input is None else [o.t_out_input])]
        if len(set(channels)) < len(channels):
            raise OptionError(f"{where}: an input is named twice", value=channels, remedy="give every gauge and T-out an input of its own")  # fmt: skip
        self.name = name
        self._card = site.find(o.card, AnalogCard, name)  # type: ignore[type-abstract]
        self._inputs = np.array(o.inputs, np.intp)
        for channel in self._inputs.tolist():
            self._card.use_input(channel, name)
        if o.t_out_input is not None:
            self._card.use_input(o.t_out_input, name)
        self._wrench = np.full(6, math.nan)
        self._restart()

    def _restart(self) -> None:
        o, c = self.options, self.calibration
        self._state = np.zeros(1, TRANSDUCER)
        t = self._state[0]
        t["inputs"], t["t_out_input"] = self._inputs, -1 if o.t_out_input is None else o.t_out_input
        t["thermistor_v"] = math.nan
        t["t_out_low_v"], t["t_out_high_v"] = T_OUT_V
        if c.thermistor_v is not None:
            t["bias_slope"], t["gain_slope"], t["thermistor_v"] = c.bias_slope, c.gain_slope, c.thermistor_v
            t["t_out_low_v"], t["t_out_high_v"] = T_OUT_COMPENSATED_V
        t["zero_v"], t["to_wrench"], t["to_percent"] = (
            o.zero_v,
            o.into_f @ c.matrix,
            100.0 * c.matrix / c.rated[:, None],
        )
        t["frozen_samples"], t["noise_limit_v"], t["clean"] = o.frozen_samples, o.noise_v, gauges.SETTLED
        self._tally, self._validity, self._found = Tally(), INVALID, 0
        self._sequence, self._sampled, self._tick = -1, -1, -1

    def open(self) -> None:
        """The card is open already; everything is compiled when this returns."""
        self._sample()
        self._restart()

    def begin(self, tick: int) -> None:
        """The card scans."""

    def read(self, tick: int, readings: Readings) -> None:
        """The wrench, unless the card has none: then it says why."""
        card = self._card
        self._tick = tick
        if self._sampled >= 0:
            readings.wrench_sequence, readings.wrench_age_ticks = self._sequence, tick - self._sampled
        if card.voltage_validity != VALID:
            return
        if card.voltage_sequence != self._sequence:
            self._sequence, self._sampled = card.voltage_sequence, tick
            self._sample()
        if self._found:
            self._report(tick, readings)
        readings.wrench_validity = self._validity
        readings.wrench_sequence, readings.wrench_age_ticks = self._sequence, tick - self._sampled
        if self._validity == VALID:
            readings.wrench_in_sensor[:] = self._wrench

    def _sample(self) -> None:
        card = self._card
        self._validity, self._found = gauges.take_sample(
            self._state, card.code, card.voltage_v, card.railed, self._wrench
        )

    def _report(self, tick: int, readings: Readings) -> None:
        for bit, (trouble, number) in TROUBLES.items():
            if self._found & bit:
                self._tally.report(tick, readings, trouble, float(self._state[0][number]))

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
        t, sampled = self._state[0], self._sampled >= 0
        volts = " ".join(f"{v:.4f}" for v in t["gauge_v"].tolist())
        off = self._found & gauges.CABLE != 0
        return [
            Finding("calibration", self.calibration.identity, True),
            Finding("gauge voltages", volts if sampled else "not read", sampled and not t["railed"], "check the transducer's cable and the inputs' order"),
            Finding("transducer's cable", "off" if off else "on", not off, "plug it in; check T-out"),
            Finding("load in per cent of rated", f"{t['load_percent']:.0f}", t["load_percent"] < HIGH_PERCENT, "unload it, then set zero_v to the gauge voltages"),
            Finding("noise", f"{1e3 * t['noise_v']:.2f} mV rms", t["noise_v"] <= t["noise_limit_v"], "check shield and ground"),
        ]  # fmt: skip
