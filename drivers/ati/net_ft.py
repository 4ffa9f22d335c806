"""An ATI Net F/T: wrenches by UDP as fast as it is set to send them, once a tick (07 section 3.4)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.ati.gauges import HIGH_PERCENT
from drivers.ati.rdt import RECORD, SATURATED_BIT, START, STATUS, STOP, Stream, request, worst_bit
from drivers.ati.resolved import Resolved, Scale
from hal import options
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.frames import FROZEN, INVALID, SATURATED, VALID
from hal.options import option
from hal.seams import Datagrams
from hal.tally import Tally
from hal.troubles import Trouble

DRAIN = 256
"""Datagrams taken in one tick at most: what a flood leaves over waits for the next."""
AGAIN_S = 0.1
"""Between two requests to a silent sensor."""
REBOOT_SHOWN_S = 0.5
"""How long a restart is told at least."""


@dataclass(frozen=True, kw_only=True)
class NetFtOptions(Resolved):
    """Settings of a device "ati_net_ft"."""

    address: str = option("192.168.1.1:49152", doc='the sensor\'s "address:port"')
    local: str = option("", doc='"address:port" of this side; empty: the system chooses')
    silent_ticks: int = option(
        5, low=1, high=1000, doc="ticks without a record after which there is no wrench any more"
    )
    frozen_records: int = option(5, low=1, high=1000, doc="records of one and the same sample that are no accident")


class AtiNetFt:
    """The newest record of every tick.

    A sensor that started anew has lost what it was biased with: its wrench is INVALID until a command without power comes
    (an operator who disables, and unbiases again before he enables), and for half a second at least.
    """

    options_type = NetFtOptions
    axes: tuple[int, ...] = ()
    measures = frozenset({"wrench"})

    def __init__(self, name: str, table: Mapping[str, Any], site: Site) -> None:
        self.options = options.read(NetFtOptions, table, f"device {name}")
        self.options.check(f"device {name}")
        self.name, self._site, self._link = name, site, None
        self._buffer = bytearray(2 * RECORD.size)
        self._restart()

    _link: Datagrams | None

    def _restart(self) -> None:
        self._stream, self._scale, self._tally = Stream(self._site.period_s), Scale(self.options), Tally()
        self._heard = self._asked = self._sampled = -1
        self._sequence = self._same = self._refused = self._tick = 0
        self._bit, self._rebooted_at = -1, -1

    def open(self) -> None:
        """Ask for records; what is silent then is asked again. Raises BackendError."""
        self._restart()
        self._link = self._site.seams.datagrams(self.options.local, self.options.address)
        self._link.send(request(START))

    def begin(self, tick: int) -> None:
        """A sensor that was switched on later, or that missed the request, is asked again."""
        if self._asked < 0:
            self._asked = self._heard = tick
        silent = tick - self._heard > self.options.silent_ticks
        if self._link is not None and silent and (tick - self._asked) * self._site.period_s >= AGAIN_S:
            self._link.send(request(START))
            self._asked = tick

    def read(self, tick: int, readings: Readings) -> None:
        """The wrench of the newest record, or why there is none."""
        self._tick = tick
        if self._link is None:
            return
        lost, corrupt = self._stream.lost, 0
        for _ in range(DRAIN):
            size = self._link.receive(self._buffer)
            if size < 0:
                break
            if size != RECORD.size:
                corrupt += 1
            else:
                self._take(tick)
        self._refused += corrupt
        if corrupt:
            self._tally.report(tick, readings, Trouble.DATAGRAM_CORRUPT, corrupt)
        if self._stream.lost > lost:
            self._tally.report(tick, readings, Trouble.DATAGRAM_GAP, self._stream.lost - lost)
        validity = self._judge(tick, readings)
        readings.wrench_validity = validity
        if self._sampled >= 0:
            readings.wrench_sequence, readings.wrench_age_ticks = self._sequence, tick - self._sampled
        if validity == VALID:
            readings.wrench_in_sensor[:] = self._scale.wrench

    def _take(self, tick: int) -> None:
        rdt, ft, status, *counts = RECORD.unpack_from(self._buffer)
        stream = self._stream
        if not stream.take(rdt, ft, tick):
            return
        self._heard, self._bit = tick, worst_bit(status)
        if stream.rebooted:
            self._rebooted_at = tick
        if stream.advance == 0 and self._sampled >= 0:
            self._same += 1
            return
        self._same, self._sampled, self._sequence = 0, tick, self._sequence + 1
        self._scale.take(counts)

    def _judge(self, tick: int, readings: Readings) -> int:
        tally, o = self._tally, self.options
        if tick - self._heard > o.silent_ticks:
            tally.report(tick, readings, Trouble.SENSOR_SILENT, tick - self._heard)
            return INVALID
        if self._rebooted_at >= 0:
            tally.report(tick, readings, Trouble.SENSOR_REBOOTED, tick - self._rebooted_at)
            return INVALID
        if self._bit >= 0:
            tally.report(tick, readings, Trouble.SENSOR_STATUS, self._bit)
            return SATURATED if self._bit == SATURATED_BIT else INVALID
        if self._same >= o.frozen_records:
            tally.report(tick, readings, Trouble.SENSOR_FROZEN, self._same)
            return FROZEN
        if self._sampled < 0:
            return INVALID
        self._scale.report_load(tick, readings, tally)
        return VALID

    def write(self, tick: int, demand: Demand) -> None:
        """A sensor is not commanded; without power its restart is forgiven."""
        shown = (tick - self._rebooted_at) * self._site.period_s >= REBOOT_SHOWN_S
        if self._rebooted_at >= 0 and not demand.power and shown:
            self._rebooted_at = -1

    def close(self) -> None:
        """Tell the sensor to stop sending."""
        if self._link is not None:
            self._link.send(request(STOP))
            self._link.close()
            self._link = None

    def health(self) -> Health:
        """Where it is, and what the link has lost."""
        stream, o = self._stream, self.options
        counts = {"lost": stream.lost, "late": stream.late, "refused": self._refused}
        counts["foreign"] = self._link.foreign if self._link is not None else 0
        identity = f"Net F/T at {o.address}, {o.counts_per_force:g} counts/{o.force_unit}, {o.counts_per_torque:g} counts/{o.torque_unit}"
        age = self._tick - self._sampled if self._sampled >= 0 else NEVER
        return Health(identity, age_ticks=age, errors={**self._tally.errors, **{k: n for k, n in counts.items() if n}})

    def probe(self) -> list[Finding]:
        """Whether it sends, and what it says of itself."""
        heard = self._sampled >= 0 and self._tick - self._heard <= self.options.silent_ticks
        status = "healthy" if self._bit < 0 else f"bit {self._bit}: {STATUS.get(self._bit, 'not in the table')}"
        return [
            Finding("records", "coming" if heard else "none", heard, f"is {self.options.address} its address, and is RDT on?"),
            Finding("status", status if heard else "not known", heard and self._bit < 0, "look the bit up in the sensor's manual"),
            Finding("load in per cent of rated", f"{self._scale.load_percent:.0f}", self._scale.load_percent < HIGH_PERCENT, "unload it"),
        ]  # fmt: skip
