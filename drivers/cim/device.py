"""The device kind "cim": impedances from the implant's computer over UDP (07 sections 4 and 7).

The frame carries one sample a tick, and samples come far more seldom; when several wait they are passed on one a tick. An open
circuit and a short are samples like any other: what they mean is for the controller's law to say.
"""

from collections.abc import Mapping
from typing import Any

from drivers.cim import sample as layouts
from drivers.cim.alarm import Alarm
from drivers.cim.gate import Gate
from drivers.cim.options import CimOptions
from drivers.cim.pairs import Pairs
from drivers.cim.probing import listen
from drivers.cim.recording import Recorder
from drivers.cim.sample import Refusal, Sample
from drivers.cim.session import Session
from drivers.cim.stream import Verdict
from hal import options
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.frames import FROZEN, INVALID, VALID
from hal.seams import Datagrams
from hal.troubles import Trouble

BUFFER = 2048
A_TICK = 64
"""Datagrams looked at in one tick; a flood waits in the socket and is lost there."""


class CimTelemetry:
    """See :class:`hal.device.Device`. Its ages count from when a sample was taken, mapped by the smallest delay met.

    Validity: INVALID while nothing came for `silent_s`, and for two sweeps after the sender started anew, in which the
    controller forgets what it remembers of the pairs; FROZEN while all pairs repeat what they read for `frozen_sweeps`.
    """

    options_type = CimOptions
    axes: tuple[int, ...] = ()
    measures = frozenset({"impedance"})

    def __init__(self, name: str, table: Mapping[str, Any], site: Site) -> None:
        where = f"device {name}"
        self.name, self._site = name, site
        self.options = options.read(CimOptions, table, where)
        self.options.check(where)
        self._decoder = layouts.load(self.options.decoder)(self.options.decoder_options, f"{where}.decoder_options")
        self._pairs = Pairs(self.options.pair_step, self.options.tip_electrode)
        self._late = round(self.options.late_s / site.period_s)
        self._silent = round(self.options.silent_s / site.period_s)
        self._buffer = bytearray(BUFFER)
        self._link: Datagrams | None = None
        self._recorder: Recorder | None = None
        self._forget()

    def _forget(self) -> None:
        period_s, sample_s = self._site.period_s, self.options.sample_period_s
        self._tick = self._opened = -1
        self._foreign = 0
        self._latest: Sample | None = None
        self._alarm = Alarm(period_s)
        self._gate = Gate(self._decoder, self._pairs, sample_s)
        self._session = Session(self._pairs.count, round(self._pairs.count * sample_s / period_s), period_s * 1e6)

    def open(self) -> None:
        """Open the socket, and a recording where the settings ask for one. Raises BackendError."""
        self._forget()
        self._link = self._site.seams.datagrams(self.options.local, self.options.peer)
        if self.options.record_to:
            self._recorder = Recorder(self.options.record_to, self.name)

    def begin(self, tick: int) -> None:
        """The sender needs no request."""

    def read(self, tick: int, readings: Readings) -> None:
        """Take in what has come, pass one sample on, and report what is wrong."""
        if self._link is None:
            return
        self._tick = tick
        if self._opened < 0:
            self._opened = tick
        for _ in range(A_TICK):
            length = self._link.receive(self._buffer)
            if length < 0:
                break
            self._hear(tick, memoryview(self._buffer)[: min(length, BUFFER)])
        self._alarm.note(tick, self._link.foreign - self._foreign)
        self._foreign = self._link.foreign
        self._session.pass_on()
        self._fill(tick, readings)
        self._report(tick, readings)

    def write(self, tick: int, demand: Demand) -> None:
        """It has no outputs."""

    def close(self) -> None:
        """Release the socket and finish the recording."""
        if self._link is not None:
            self._link.close()
        if self._recorder is not None:
            self._recorder.close()
        self._link = self._recorder = None

    def health(self) -> Health:
        """Who sends what, and all counters."""
        session, latest = self._session, self._latest
        run = "" if latest is None or latest.run is None else f", run {latest.run:08x}"
        simulated = ", simulated" if latest is not None and latest.is_simulated else ""
        age = NEVER if session.newest_tick is None else self._tick - session.newest_tick
        own = {"foreign": self._foreign, "overflows": session.overflows, "withheld": session.withheld, "stale_pairs": session.stale}  # fmt: skip
        if self._recorder is not None:
            own["not_recorded"] = self._recorder.lost
        identity = f"{self.options.decoder} from {self.options.peer}{run}{simulated}"
        return Health(identity, "", age, {**self._gate.counts(), **own})

    def probe(self) -> list[Finding]:
        """Listen for a sweep; waits up to some two seconds."""
        if self._link is None:
            return [Finding("telemetry", "the device is not open", False, "open it first")]
        return listen(self._link, self._decoder, self._pairs, self.options)

    def _hear(self, tick: int, data: memoryview) -> None:
        if self._recorder is not None:
            self._recorder.note(round((tick - self._opened) * self._site.period_s * 1e6), data)
        judged = self._gate.judge(data)
        if isinstance(judged, Refusal):
            self._alarm.note(tick)
            return
        sample, verdict = judged
        if verdict is Verdict.OLD:
            return
        if verdict is Verdict.NEW_RUN:
            self._session.start_anew(tick)
        self._latest = sample
        self._session.lose(tick, self._gate.stream.lost)
        self._session.hear(tick, sample, self._gate.pair)

    def _silence(self, tick: int) -> int:
        newest = self._session.newest_tick
        return tick - (self._opened if newest is None else newest)

    def _fill(self, tick: int, readings: Readings) -> None:
        session = self._session
        readings.impedance_sequence = session.delivered
        if session.pair < 0:
            return
        readings.impedance_age_ticks = min(tick - session.sample_tick, NEVER)
        if self._silence(tick) > self._silent:
            readings.impedance_validity = INVALID
        elif session.repeated >= self.options.frozen_sweeps:
            readings.impedance_validity = FROZEN
        else:
            readings.impedance_validity = VALID
            readings.impedance_ohm, readings.impedance_pair = session.ohm, session.pair

    def _report(self, tick: int, readings: Readings) -> None:
        """All are as grave, so the first is told: the cause before its effects."""
        session, silence = self._session, self._silence(tick)
        if refused := self._alarm.rate(tick):
            readings.report(Trouble.TELEMETRY_CORRUPT, refused)
        if tick < session.armed_from:
            readings.report(Trouble.TELEMETRY_NEW_RUN)
        if silence > self._late:
            readings.report(Trouble.TELEMETRY_SILENT, silence)
        if session.repeated >= self.options.frozen_sweeps:
            readings.report(Trouble.TELEMETRY_FROZEN, session.repeated)
        if missing := session.missing(tick):
            readings.report(Trouble.TELEMETRY_GAP, missing)
