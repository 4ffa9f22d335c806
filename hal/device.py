"""What a device is: one part of a hardware backend, found by its kind in the settings.

    [[backend.options.devices]]
    kind = "sensoray526"      # entry point of the group rtctl.devices
    name = "card_a"
    base = 0x2C0              # everything else is the device's own table

A device says which axes it turns and what else it measures; :mod:`drivers.backend` puts them together to the sensor
frame. Devices are made in the order of the settings, and may use those before them: an amplifier its card.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import Any, Protocol, TypeVar

import numpy as np

from hal.errors import BackendError, OptionError
from hal.frames import INVALID
from hal.seams import Seams
from hal.troubles import TABLE, Trouble

GROUP = "rtctl.devices"
NEVER = 2**31 - 1
"""Age of what was never sampled."""
D = TypeVar("D")


class Readings:
    """What the devices of a backend measured in one tick; each fills in what is its own.

    Every read starts with all of it INVALID, NaN, old, and without power.

    Attributes:
        axis_angle_rad (n,): accumulated since the device was opened.
        axis_validity, axis_sequence, axis_age_ticks (n,): as in the sensor frame, axis by axis.
        axis_powered, axis_fault (n,): amplifier energised; amplifier reports a fault.
        wrench_in_sensor (6,), wrench_validity, wrench_sequence, wrench_age_ticks.
        impedance_ohm, impedance_pair, impedance_validity, impedance_sequence, impedance_age_ticks.
        device_time_s: of the one device that measures "time", as in the sensor frame; it latches it in `begin`.
        watchdog_tripped: a device removed power because nobody wrote.
        trouble, trouble_value, trouble_device: the gravest, see :meth:`report`.
    """

    def __init__(self, axes: int) -> None:
        self.axis_angle_rad = np.empty(axes)
        self.axis_validity = np.empty(axes, np.uint8)
        self.axis_sequence = np.empty(axes, np.int64)
        self.axis_age_ticks = np.empty(axes, np.int32)
        self.axis_powered = np.empty(axes, np.bool_)
        self.axis_fault = np.empty(axes, np.bool_)
        self.wrench_in_sensor = np.empty(6)
        self.device = -1
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.axis_angle_rad.fill(np.nan)
        self.axis_validity.fill(INVALID)
        self.axis_sequence.fill(0)
        self.axis_age_ticks.fill(NEVER)
        self.axis_powered.fill(False)
        self.axis_fault.fill(False)
        self.wrench_in_sensor.fill(np.nan)
        self.wrench_validity, self.wrench_sequence, self.wrench_age_ticks = INVALID, 0, NEVER
        self.impedance_ohm, self.impedance_pair = np.nan, -1
        self.device_time_s = np.nan
        self.impedance_validity, self.impedance_sequence, self.impedance_age_ticks = INVALID, 0, NEVER
        self.watchdog_tripped = False
        self.trouble, self.trouble_value, self.trouble_device, self.trouble_grade = 0, np.nan, -1, 0

    def report(self, trouble: Trouble, value: float = np.nan) -> None:
        """Say what is wrong with the device that is being read; of several the gravest goes into the record."""
        grade = TABLE[trouble].grade
        if grade > self.trouble_grade:
            self.trouble_grade, self.trouble, self.trouble_value = int(grade), int(trouble), value
            self.trouble_device = self.device


class Demand:
    """What the controller wants in one tick: checked, finite, and zero without power.

    Attributes:
        command_v (n,): set value of each amplifier [V], -10 .. 10.
        power: energise the amplifiers.
        array_loaded: the operator has declared that an array is in the gripper; only a simulated assistant looks at it.
        clear_faults: True in the first write without power after one with it, or after opening: the moment to reset
            amplifiers that latched something. Never energises anything by itself.
    """

    def __init__(self, axes: int) -> None:
        self.command_v = np.zeros(axes)
        self.power = False
        self.array_loaded = False
        self.clear_faults = False


@dataclass(frozen=True)
class Health:
    """What a device tells of itself to people: a line of ``rtctl devices``. May be asked at any time, and is not fast."""

    identity: str
    """serial number, signature, calibration: what tells this one from another"""
    firmware: str = ""
    age_ticks: int = NEVER
    errors: dict[str, int] = field(default_factory=dict)
    """error counters by name, since opened"""


@dataclass(frozen=True)
class Finding:
    """One thing that a probe looked at."""

    what: str
    found: str
    good: bool
    remedy: str = ""


class Device(Protocol):
    """One device. Nothing but `open` and `probe` may raise (BackendError), wait or allocate."""

    options_type: type
    """frozen dataclass of its own settings, for checking and for the reference"""
    axes: tuple[int, ...]
    """numbers of the axes it turns"""
    measures: frozenset[str]
    """of "wrench", "impedance" and "time" (see `loop.clock`), what it measures"""

    def __init__(self, name: str, table: Mapping[str, Any], site: "Site") -> None:
        """From its own table of settings, without `kind` and `name`. Connects to nothing. Raises OptionError."""

    def open(self) -> None:
        """Connect through the site's seams and check; no power. Raises BackendError with what to do."""

    def begin(self, tick: int) -> None:
        """Start what takes time (a conversion, a request). Called for all devices before the first is read."""

    def read(self, tick: int, readings: Readings) -> None:
        """Put in what was measured, and report what is wrong."""

    def write(self, tick: int, demand: Demand) -> None:
        """Pass on the commands. Called every tick in reverse order: a card after what stages values on it."""

    def close(self) -> None:
        """Remove power and release the device. May be called twice."""

    def health(self) -> Health:
        """What ``rtctl devices`` shows."""

    def probe(self) -> list[Finding]:
        """Check wiring without moving anything; the device is open and has no power."""


@dataclass
class Site:
    """Where a device lives: the loop's period, the seams, and the devices made before it."""

    period_s: float
    watchdog_ticks: int
    seams: Seams
    devices: dict[str, Device] = field(default_factory=dict)

    def find(self, name: str, kind: type[D], wanted_by: str) -> D:
        """Device `name`, which must have what `kind` (a runtime-checkable protocol) asks. Raises OptionError."""
        found = self.devices.get(name)
        if found is None:
            raise OptionError(f"device {wanted_by} needs a device that is not there", value=name, bound=" | ".join(self.devices) or "none before it", remedy="list it before the one that uses it")  # fmt: skip
        if not isinstance(found, kind):
            raise OptionError(f"device {wanted_by} cannot use this device", value=name, bound=kind.__name__)
        return found


def load(kind: str) -> type[Device]:
    """The class of devices of `kind`. Raises BackendError."""
    found = {e.name: e for e in entry_points(group=GROUP)}
    if kind not in found:
        raise BackendError("no such kind of device", value=kind, bound=" | ".join(sorted(found)), remedy="set kind in [[backend.options.devices]]")  # fmt: skip
    return found[kind].load()
