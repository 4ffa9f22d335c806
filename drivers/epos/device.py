"""Maxon EPOS drives on one CAN bus: the device kind "epos_bus" (07 sections 2.3 to 2.6).

Every `divisor` ticks there is an exchange: a set value to each drive, then one SYNC, at which all drives take over what
they got and sample what they answer. Between two exchanges the angles age. Drives are armed, stopped and reset one step
an exchange; going without power is told at once.

A set value is the mean of the commands since the last exchange. Seen every tick the angles are stairs, and the derivative of
a controller is all in the ticks of their steps: taking the command of one tick would take all of it, or nothing.
"""

from collections.abc import Mapping
from typing import Any

from drivers.epos import options
from drivers.epos.axis import Axis
from drivers.epos.link import Link
from drivers.epos.objects import (
    CONTROLWORD_OBJECT,
    MODE_NUMBERS,
    SUPPORTED_MODES,
    Setting,
    process_data,
    safety_settings,
)
from drivers.epos.probe import look_at
from drivers.epos.service import PREOPERATIONAL, START, Service
from drivers.epos.states import DISABLE, State
from drivers.epos.watch import Watch
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.errors import BackendError
from hal.frames import VALID

ENABLED, FAULTY = State.ENABLED, (State.FAULT, State.REACTING)  # the tick has no time to look up enums
NOT_TO_RESET = (State.UNKNOWN, State.REACTING)
ENERGISED = (State.ENABLED, State.QUICK_STOP, State.REACTING)


class EposBus:
    """See :class:`hal.device.Device`; settings in :class:`drivers.epos.options.EposOptions`."""

    options_type = options.EposOptions
    measures: frozenset[str] = frozenset()

    def __init__(self, name: str, table: Mapping[str, Any], site: Site) -> None:
        self.name, self._site = name, site
        self.options = options.read(name, table, site)
        divisor, period_s = self.options.divisor, site.period_s
        self._axes = tuple(Axis(node, divisor, period_s) for node in self.options.nodes)
        self.axes = tuple(axis.number for axis in self._axes)
        self._beat_ticks = max(1, round(self.options.heartbeat_ms / period_s / 1e3))
        self._stop_ticks = round(self.options.quick_stop_ms / period_s / 1e3)
        self._link: Link | None = None
        self._watch: Watch | None = None
        self._service: Service | None = None
        self._identity = self._firmware = ""
        self._age_ticks = NEVER

    def open(self) -> None:
        """Write the safety settings and the process data, read them back, and set the nodes operational."""
        o = self.options
        bus = self._site.seams.can_bus(o.interface, o.channel, o.bitrate)
        try:
            self._service = service = Service(bus, [node.node for node in o.nodes])
            service.command(PREOPERATIONAL)
            self._identify(service)
            for node in o.nodes:
                service.write(node.node, Setting(CONTROLWORD_OBJECT, 0, 2, DISABLE))
                for setting in safety_settings(o, node, self._site) + process_data(node):
                    service.hold(node.node, setting)
            service.command(START)
            service.forget()
        except BaseException:
            bus.shutdown()
            raise
        for axis in self._axes:
            axis.forget()
        self._link = Link(bus, self._axes, o.master)
        self._watch = Watch(self._link, o.divisor, self._beat_ticks)
        self._power = self._armed = self._urgent = False
        self._beat_tick = self._stop_tick = -NEVER
        self._age_ticks = NEVER
        self._reset = [False] * len(self._axes)
        self._summed = 0

    def _identify(self, service: Service) -> None:
        """Who answers, and whether it has the mode that the settings ask for."""
        names, firmware = [], []
        for node in self.options.nodes:
            vendor, product, revision, serial = (service.read(node.node, 0x1018, sub) for sub in (1, 2, 3, 4))
            names.append(f"node {node.node}: {vendor:X}-{product:08X} serial {serial:X}")
            firmware.append(f"{revision >> 16:04X}")
            mode = MODE_NUMBERS[node.mode]
            if mode > 0 and not service.read(node.node, SUPPORTED_MODES, 0) >> mode - 1 & 1:
                raise BackendError("a drive does not have this mode", value=f"{node.mode} at node {node.node}", remedy="check the generation in the settings, and the drive's firmware")  # fmt: skip
        self._identity, self._firmware = "; ".join(names), ", ".join(firmware)

    def begin(self, tick: int) -> None:
        """The exchange was started by the last write."""

    def read(self, tick: int, readings: Readings) -> None:
        """Angles and what is wrong."""
        link, watch = self._link, self._watch
        if link is None or watch is None:
            return
        link.receive(tick)
        known = len(watch.latched)
        watch.judge(tick, readings, self._power)
        self._urgent = self._urgent or len(watch.latched) > known
        powered = self._power and not watch.latched
        age_ticks, sequence, angle_rad = readings.axis_age_ticks, readings.axis_sequence, readings.axis_angle_rad
        oldest = 0
        for place, axis in enumerate(self._axes):
            i, state = axis.number, axis.state
            if state in FAULTY or link.emergency[place]:
                readings.axis_fault[i] = True
            if not axis.samples:
                oldest = NEVER
                continue
            age = tick - axis.sampled_tick
            if age > oldest:
                oldest = age if age < NEVER else NEVER
            age_ticks[i] = age if age < NEVER else NEVER
            sequence[i] = axis.samples
            if powered and state is ENABLED:
                readings.axis_powered[i] = True
            if not (axis.silent or axis.jump_counts or link.rebooted[place] or link.off):
                angle_rad[i] = axis.angle_rad
                readings.axis_validity[i] = VALID
        self._age_ticks = oldest

    def write(self, tick: int, demand: Demand) -> None:
        """Every divisor ticks, and at once when power goes or something stopped the drives."""
        link, watch = self._link, self._watch
        if link is None or watch is None:
            return
        if demand.clear_faults:
            watch.clear()
            self._reset = [True] * len(self._axes)
        if tick - self._beat_tick >= self._beat_ticks:
            self._beat_tick = tick
            link.beat()
        arm = demand.power and not watch.latched
        if self._armed and not arm:
            self._stop_tick, self._urgent = tick, True
        self._power, self._armed = demand.power, arm
        command_v = demand.command_v.tolist()
        for axis in self._axes:
            axis.sum_v += command_v[axis.number]
        self._summed += 1
        late = tick - link.sync_tick - self.options.divisor
        if late < 0 and link.exchanges and not self._urgent:
            return
        if late > 0 and link.exchanges:
            link.sync_late += 1
        self._urgent = False
        coast = tick - self._stop_tick > self._stop_ticks
        for place, axis in enumerate(self._axes):
            axis.demand(axis.sum_v / self._summed, arm, coast, self._reset[place])
            if arm or axis.state not in NOT_TO_RESET:
                self._reset[place] = False  # one rising edge, for one acknowledgement
            axis.sum_v = 0.0
        self._summed = 0
        link.exchange(tick)

    def close(self) -> None:
        """Stop along the ramps, take the voltage away, leave operation and release the bus."""
        link, self._link = self._link, None
        if link is None:
            return
        exchange_s = self.options.divisor * self._site.period_s
        for left in range(round(self.options.quick_stop_ms / exchange_s / 1e3), -1, -1):
            if left and not any(axis.state in ENERGISED for axis in self._axes):
                continue
            for axis in self._axes:
                axis.demand(0.0, arm=False, coast=left == 0, reset=False)
            link.exchange(link.sync_tick)
            link.settle(exchange_s)
        for axis in self._axes:
            link.release(axis.options.node)
        link.settle(exchange_s)
        self._service = None
        link.bus.shutdown()

    def health(self) -> Health:
        """Identity of all drives, and the counters of the bus."""
        link = self._link
        errors = {} if link is None else {
            "unsent": link.all_unsent, "malformed": link.malformed, "error_frames": link.error_frames,
            "emergencies": link.emergencies, "sync_late": link.sync_late,
        }  # fmt: skip
        return Health(self._identity, self._firmware, self._age_ticks, errors)

    def probe(self) -> list[Finding]:
        """Ask every drive what it is, what it complains of, and whether it holds its settings."""
        if self._service is None:
            return []
        return [f for node in self.options.nodes for f in look_at(self._service, self.options, node, self._site)]  # fmt: skip
