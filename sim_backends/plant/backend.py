"""The plant as a backend: options in, compiled bench out."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hal import options
from hal.backend import CompiledDevice
from hal.errors import BackendError
from hal.signals import Table
from sim_backends.plant import device, snapshot, trial
from sim_backends.plant.options import PlantOptions
from sim_backends.plant.state import AXES, TABLE, pack


class PlantBackend:
    """Planar insertion robot, stylet drive, force sensor, array and cochlea, simulated tick by tick (08).

    Time is the tick number alone: nothing here looks at a clock but the crystal, whose time goes nowhere; a run depends on options, seed, and the ticks and
    frames it is given. The mechanics persist from one session to the next, as those of a real bench do.

    Args:
        table: settings, see :class:`~sim_backends.plant.options.PlantOptions`.
        period_s: time between two ticks.
        seed: of the sensor noise and of the sensor's matrix error, and of what `trial` scatters.

    Attributes:
        options: as they were given.
        drawn: those of this very insertion, :func:`sim_backends.plant.trial.draw`.

    Raises:
        OptionError: a setting is wrong. RobotError: the true geometry cannot be assembled.
    """

    axes = AXES
    simulated = True
    options_type = PlantOptions
    """for the reference of settings"""

    def __init__(self, table: Mapping[str, Any], *, period_s: float, seed: int) -> None:
        self.options = options.read(self.options_type, table, "backend.options")
        self.watchdog_ticks = self.options.watchdog_ticks
        self._sampled = trial.sample(self.options, seed)
        self.drawn = trial.place(self._sampled)
        self._device = pack(self.drawn, period_s, seed)
        self._record = self._device[0]

    def open(self) -> None:
        """Start a session: no power, encoders at zero."""
        d = self._record
        d["opened"], d["started"], d["powered"], d["tripped"], d["amplifier_fault"] = 1, 0, 0, 0, 0
        d["command_v"], d["failed"] = 0.0, 0
        d["axes_sequence"] = d["wrench_sequence"] = 0
        d["motor"]["zero_rad"] = d["motor"]["angle_rad"]

    def read(self, tick: int, sensors: np.ndarray) -> None:
        """Simulate up to grid tick `tick` and fill the sensor frame, shape (1,)."""
        device.read_arrays(self._device, tick, sensors)

    def write(self, tick: int, actuators: np.ndarray) -> None:
        """Take the actuator frame, shape (1,), for the time after `tick`."""
        device.write_arrays(self._device, tick, actuators)

    def close(self) -> None:
        """End the session: no power, no measurements."""
        d = self._record
        d["opened"], d["powered"] = 0, 0
        d["command_v"] = 0.0

    def compiled(self) -> CompiledDevice:
        """Kernels of this very bench and its record."""
        return CompiledDevice(device.read, device.write, self._device)

    def truth(self) -> tuple[Table, np.ndarray]:
        """True state of the bench: signals and their live record, shape (1,), as of the last read."""
        return TABLE, self._device["truth"]

    def look(self, angle_rad: np.ndarray, current_a: np.ndarray, wrench_in_sensor: np.ndarray) -> None:
        """What real electronics would be wired to, as of the last read, without any judgement.

        angle_rad, current_a: (4,) of the motor shafts, zero where the robot is at home. wrench_in_sensor: (6,) in {F}
        [N, N mm], what the sensor bears, with its errors, however large.
        """
        device.look_arrays(self._device, angle_rad, current_a, wrench_in_sensor)

    def failure(self) -> BackendError | None:
        """Why the bench stands still, if the array's step did not converge however small it was made."""
        d = self._record
        if not d["failed"]:
            return None
        return BackendError(
            "the simulated array did not come to an equilibrium, and the bench stands still",
            value=f"tick {d['tick']}, {d['array']['retries']} steps cut up, wrench {d['array']['wrench'].tolist()}",
            bound="eight halvings of a tick, or the iterations of a millisecond",
            remedy="look at its state: python -m studies.failed_step FILE",
        )

    def snapshot(self) -> bytes:
        """All of the bench's state; :meth:`restore` takes it back."""
        return snapshot.to_bytes(self._device)

    def restore(self, data: bytes) -> None:
        """Put the bench into the state of a :meth:`snapshot`, its parameters included.

        Raises:
            BackendError: the bytes are not a state of this bench.
        """
        self._device[:] = snapshot.from_bytes(data)

    def drawn_values(self) -> dict[str, float]:
        """What makes this insertion another one than that of the next seed."""
        return trial.told(self._sampled)
