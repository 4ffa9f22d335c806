"""What an emulator is: the double of a device behind the same seam, between a bench's physics and the driver.

It is made from the same table of settings as the device it doubles, found by the same kind in the group
``rtctl.emulators``, and knows nothing of the driver. It has no clock: time is the tick of the bench.
"""

from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import Any, Protocol

import numpy as np

from hal.errors import BackendError

GROUP = "rtctl.emulators"


class Bench:
    """The physical quantities that emulators see and drive, at one tick.

    Attributes:
        angle_rad (n,): of the motor shafts, since the bench was made.
        wrench_in_sensor (6,): what the sensor's body bears and its electronics add, in {F} [N, N mm].
        impedance_ohm, impedance_pair, impedance_sequence: latest sample of the implant; sequence 0 for none yet.
        command_v (n,): set value that reaches each amplifier. enabled (n,): its enable input. Emulators write both.
        current_a (n,): that flows in each motor.
        array_loaded: somebody holds that an array belongs into the gripper, and sees to it.
    """

    def __init__(self, axes: int) -> None:
        self.angle_rad = np.zeros(axes)
        self.wrench_in_sensor = np.zeros(6)
        self.impedance_ohm, self.impedance_pair, self.impedance_sequence = np.nan, -1, 0
        self.command_v = np.zeros(axes)
        self.enabled = np.zeros(axes, np.bool_)
        self.current_a = np.zeros(axes)
        self.array_loaded = False


class Emulator(Protocol):
    """One emulated device."""

    faults: tuple[str, ...]
    """names of what :meth:`inject` knows"""
    apart: bool
    """it may live in a process of its own, since all that ties it to others is a link such as UDP"""

    def __init__(self, name: str, table: Mapping[str, Any], station: "Station") -> None:
        """From the table of the device it doubles, without `kind` and `name`; plugs itself into the station's switchboard."""

    def sense(self, tick: int, bench: Bench) -> None:
        """The bench has come to `tick`: take from it what the device measures, and let the device's own time pass."""

    def drive(self, tick: int, bench: Bench) -> None:
        """The driver has written: put on the bench what the device's outputs do. A dead watchdog acts here or in sense."""

    def inject(self, fault: str, value: float = 1.0) -> None:
        """Break something by name; 0 mends it. Raises BackendError for a name that is not known."""


class Station:
    """Where an emulator lives: the period, a seed, the switchboard to plug into, and the emulators made before it."""

    def __init__(self, period_s: float, seed: int, switchboard: Any) -> None:
        self.period_s, self.seed, self.switchboard = period_s, seed, switchboard
        self.emulators: dict[str, Emulator] = {}

    def card_memory(self, base: int, dtype: np.dtype) -> np.ndarray:  # noqa: ARG002
        """Where the record (1,) of the card at `base` lives; a bench of several processes puts it where all can see it."""
        return np.zeros(1, dtype)


def load(kind: str) -> type[Emulator]:
    """The class that emulates devices of `kind`. Raises BackendError."""
    found = {e.name: e for e in entry_points(group=GROUP)}
    if kind not in found:
        raise BackendError("no emulator for this kind of device", value=kind, bound=" | ".join(sorted(found)))
    return found[kind].load()
