"""The drivers of the settings on the emulated bench, all in one process and without a clock: the backend "rig"."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from hal import backend as backends
from hal import options
from hal.emulator import Station
from hal.errors import BackendError
from hal.options import option
from hal.signals import Table
from hal.switchboard import Switchboard
from sim_backends.rig.rig import Rig


@dataclass(frozen=True)
class RigOptions:
    """What the bench has beside the devices, [backend.options.rig]."""

    plant: dict = option({}, doc="options of the backend plant, which is behind the emulated devices")
    realtime_priority: int = option(
        60, low=1, high=98, doc="SCHED_FIFO priority of the bench in processes of its own; below that of the loop"
    )


class RigBackend:
    """Driver, protocol, emulator and plant as one simulated backend that runs in lockstep.

    Takes the settings of the backend "hardware" as they are, so that `backend.name = "rig"` is all that a real bench
    and its double differ by.

    Args:
        table: settings of the backend "hardware"; their `rig` has the plant's.
        period_s: time between two ticks.
        seed: of the plant.

    Raises:
        OptionError, BackendError: see the backends "hardware" and "plant".
    """

    simulated = True
    options_type, options_path = RigOptions, "backend.options.rig"
    """for the reference of settings"""

    def __init__(self, table: Mapping[str, Any], *, period_s: float, seed: int) -> None:
        self.options = options.read(RigOptions, table.get("rig", {}), self.options_path)
        switchboard = Switchboard()
        self._hardware = cast(Any, backends.load("hardware", table, period_s=period_s, seed=seed))
        self._hardware.use(switchboard)
        self.rig = Rig(table["devices"], self.options.plant, Station(period_s, seed, switchboard))
        if self._hardware.axes != self.rig.plant.axes:
            raise BackendError("the plant has another number of axes", value=self.rig.plant.axes, bound=f"{self._hardware.axes} of the devices")  # fmt: skip
        self.axes, self.watchdog_ticks = self._hardware.axes, self._hardware.watchdog_ticks

    @property
    def devices(self) -> dict[str, Any]:
        """The drivers by name."""
        return self._hardware.devices

    def open(self) -> None:
        """Open every device. Raises BackendError with what to do."""
        if self.rig.tick < 0:
            self.rig.step(0)
        self._hardware.open()

    def read(self, tick: int, sensors: np.ndarray) -> None:
        """Move the bench on to grid tick `tick` and read the devices, into a frame of shape (1,)."""
        if tick > self.rig.tick:
            self.rig.step(tick)
        self._hardware.read(tick, sensors)

    def write(self, tick: int, actuators: np.ndarray) -> None:
        """Pass the actuator frame, shape (1,), to the devices."""
        self._hardware.write(tick, actuators)

    def close(self) -> None:
        """Close every device; the bench itself stays on."""
        self._hardware.close()

    def compiled(self) -> None:
        """Drivers run in the interpreter."""
        return

    def truth(self) -> tuple[Table, np.ndarray]:
        """That of the plant."""
        return self.rig.plant.truth()

    def drawn_values(self) -> dict[str, float]:
        """What the seed decided about the plant."""
        return self.rig.plant.drawn_values()

    def failure(self) -> BackendError | None:
        """Why the plant stands still, if it does."""
        return self.rig.plant.failure()

    def snapshot(self) -> bytes:
        """The plant's state."""
        return self.rig.plant.snapshot()
