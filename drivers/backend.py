"""The backend of real devices: what each of them measured, put together to one frame, and one watchdog over all."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hal import options
from hal import seams as seam
from hal.device import Demand, Device, Readings, Site, load
from hal.errors import BackendError, OptionError
from hal.frames import VALID
from hal.options import option
from hal.seams import Seams
from hal.signals import Table

LIMIT_V = 10.0


@dataclass(frozen=True)
class HardwareOptions:
    """Settings of the backend "hardware", beside its list of tables `devices`: see :mod:`hal.device`."""

    seams: str = option("target", doc='how devices are reached: "target" is this machine, "rig" the emulated bench')
    rig: dict = option({}, doc="of the emulated bench, if the devices are: see [backend.options.rig]")
    watchdog_ticks: int = option(50, low=1, high=1000, doc="ticks without a command after which power is removed")


class HardwareBackend:
    """Devices of one robot behind :class:`hal.backend.Backend`.

    Every tick begins with starting what takes time, then all devices are read, each in its turn; a group of the sensor
    frame is as valid as the worst of its parts, as old as the oldest. The devices' own watchdogs remove power when this
    process dies; the one here does when the loop stands still and comes back.

    Args:
        table: settings, see :class:`HardwareOptions`.
        period_s: time between two ticks.
        seed: ignored; devices draw nothing.

    Raises:
        OptionError: a setting is wrong. BackendError: no such kind of device.
    """

    simulated = False
    options_type = HardwareOptions

    def __init__(self, table: Mapping[str, Any], *, period_s: float, seed: int = 0) -> None:  # noqa: ARG002
        self.options = options.read(
            HardwareOptions, {k: v for k, v in table.items() if k != "devices"}, "backend.options"
        )
        self.watchdog_ticks = self.options.watchdog_ticks
        self._site = Site(period_s, self.watchdog_ticks, seam.load(self.options.seams))
        self.devices = self._site.devices
        for i, entry in enumerate(_entries(table)):
            self._add(i, dict(entry))
        self.axes = _count_axes(self.devices)
        _check_measures(self.devices)
        self._order = list(self.devices.values())
        self._reversed = self._order[::-1]
        self._readings, self._demand = Readings(self.axes), Demand(self.axes)
        self._opened = self._tripped = False
        self._write_tick = -1

    def _add(self, number: int, entry: dict[str, Any]) -> None:
        where = f"backend.options.devices[{number}]"
        for key in ("kind", "name"):
            if not isinstance(entry.get(key), str) or not entry[key]:
                raise OptionError(f"{where}.{key} must be a word", value=entry.get(key), remedy="give every device a kind and a name of its own")  # fmt: skip
        kind, name = entry.pop("kind"), entry.pop("name")
        if name in self.devices:
            raise OptionError("two devices have the same name", value=name, remedy=f"rename {where}")
        self.devices[name] = load(kind)(name, entry, self._site)

    def use(self, seams: Seams) -> None:
        """Reach the devices in another way than the settings say: for benches in the same process, before open."""
        self._site.seams = seams

    def open(self) -> None:
        """Open every device, in order. Raises BackendError; what was opened before is closed then."""
        try:
            for name, device in self.devices.items():
                try:
                    device.open()
                except BackendError as error:
                    raise BackendError(f"device {name}: {error.what}", value=error.value, bound=error.bound, remedy=error.remedy) from error  # fmt: skip
        except BaseException:
            self.close()
            raise
        self._opened, self._tripped = True, False
        self._write_tick = -1
        self._demand.clear_faults = True

    def read(self, tick: int, sensors: np.ndarray) -> None:
        """Fill the sensor frame, shape (1,), for grid tick `tick`."""
        readings = self._readings
        readings.clear()
        if self._opened:
            demand = self._demand
            if demand.power and tick - self._write_tick > self.watchdog_ticks:
                self._tripped = True
                self._cut(tick)
            for device in self._order:
                device.begin(tick)
            for number, device in enumerate(self._order):
                readings.device = number
                device.read(tick, readings)
            if readings.watchdog_tripped:
                self._tripped = True
        self._merge(sensors)

    def write(self, tick: int, actuators: np.ndarray) -> None:
        """Pass the actuator frame, shape (1,), on to the devices."""
        if not self._opened:
            return
        demand, frame = self._demand, actuators[0]
        demand.array_loaded = bool(frame["array_loaded"])
        if not frame["power"]:
            demand.clear_faults = demand.clear_faults or demand.power or self._tripped
            self._tripped = False
            self._cut(tick)
            demand.clear_faults = False
            return
        command = frame["command_v"]
        if self._tripped or not np.isfinite(command).all():
            return  # as if nobody had written: nothing is passed on, and the watchdog goes on counting
        np.clip(command, -LIMIT_V, LIMIT_V, out=demand.command_v)
        demand.power = True
        self._write_tick = tick
        for device in self._reversed:
            device.write(tick, demand)

    def close(self) -> None:
        """Remove power and release the devices, the last one opened first."""
        self._opened = False
        self._demand.power = False
        self._demand.command_v.fill(0.0)
        for device in self._reversed:
            device.close()

    def compiled(self) -> None:
        """Devices are reached through the interpreter."""
        return

    def truth(self) -> tuple[Table, np.ndarray] | None:
        """Nobody knows the truth of real devices."""
        return None

    def _cut(self, tick: int) -> None:
        demand = self._demand
        demand.power = False
        demand.command_v.fill(0.0)
        for device in self._reversed:
            device.write(tick, demand)

    def _merge(self, sensors: np.ndarray) -> None:
        r, s = self._readings, sensors[0]
        worst = VALID
        for validity in r.axis_validity.tolist():
            if validity != VALID:
                worst = validity
        s["axes_validity"] = worst
        s["axis_angle_rad"] = r.axis_angle_rad if worst == VALID else math.nan
        s["axes_sequence"], s["axes_age_ticks"] = r.axis_sequence.min(), r.axis_age_ticks.max()
        valid = r.wrench_validity == VALID
        s["wrench_validity"] = r.wrench_validity
        s["wrench_in_sensor"] = r.wrench_in_sensor if valid else math.nan
        s["wrench_sequence"], s["wrench_age_ticks"] = r.wrench_sequence, r.wrench_age_ticks
        valid = r.impedance_validity == VALID
        s["impedance_validity"] = r.impedance_validity
        s["impedance_ohm"], s["impedance_pair"] = (r.impedance_ohm, r.impedance_pair) if valid else (math.nan, -1)
        s["impedance_sequence"], s["impedance_age_ticks"] = r.impedance_sequence, r.impedance_age_ticks
        s["device_time_s"] = r.device_time_s
        s["powered"] = self._opened and not self._tripped and bool(r.axis_powered.all())
        s["watchdog_tripped"] = self._tripped
        s["amplifier_fault"] = bool(r.axis_fault.any())
        s["trouble"], s["trouble_device"] = r.trouble, r.trouble_device
        s["trouble_grade"], s["trouble_value"] = r.trouble_grade, r.trouble_value


def _entries(table: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The devices' own tables, which are theirs to check; here they only have to be tables."""
    entries = table.get("devices", ())
    if not isinstance(entries, list | tuple) or not entries or not all(isinstance(e, Mapping) for e in entries):
        raise OptionError("backend.options.devices must be a list of tables", value=entries or None, remedy="write [[backend.options.devices]] once for every device")  # fmt: skip
    return list(entries)


def _count_axes(devices: Mapping[str, Device]) -> int:
    """The axes of all devices must be 0, 1, 2, ... without gap or double."""
    turned: dict[int, str] = {}
    for name, device in devices.items():
        for axis in device.axes:
            if axis in turned:
                raise OptionError(
                    "two devices turn the same axis", value=axis, remedy=f"look at {turned[axis]} and {name}"
                )
            turned[axis] = name
    if not turned or sorted(turned) != list(range(len(turned))):
        raise OptionError(
            "an axis has no device", value=sorted(turned), bound=f"0 .. {max(turned, default=0)}, each once"
        )
    return len(turned)


def _check_measures(devices: Mapping[str, Device]) -> None:
    for what in ("wrench", "impedance", "time"):
        found = [name for name, device in devices.items() if what in device.measures]
        if len(found) > 1:
            raise OptionError(f"two devices measure the {what}", value=found, bound="one")
