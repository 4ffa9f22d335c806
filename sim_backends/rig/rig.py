"""The emulated bench: the plant's motors, sensor and implant, and an emulator for every device of the settings around it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hal import backend as backends
from hal import emulator as emulators
from hal.emulator import Bench, Emulator, Station
from hal.errors import BackendError, OptionError
from hal.frames import actuator_frame, sensor_frame


class Rig:
    """What the driver's cables end in, from tick to tick: outputs act, the plant moves, sensors see it.

    The plant has an amplifier for each of its axes. Its own watchdog never matters: a device's does, by opening its enable
    line. A device without wires to the plant (a bus of drives with motors of their own) is a guest on the bench.

    Args:
        devices: their tables, `kind` and `name` included, as in the settings of the backend "hardware".
        plant: options of the backend "plant".
        station: where the emulators plug in.

    Raises:
        OptionError: a setting is wrong. BackendError: a kind of device has no emulator.
    """

    def __init__(self, devices: Sequence[Mapping[str, Any]], plant: Mapping[str, Any], station: Station) -> None:
        self.station = station
        self.plant: Any = backends.load("plant", plant, period_s=station.period_s, seed=station.seed)
        self.bench = Bench(self.plant.axes)
        for entry in devices:
            add_emulator(entry, station)
        self._order: list[Emulator] = list(station.emulators.values())
        self._sensors = np.zeros(1, sensor_frame(self.plant.axes))
        self._actuators = np.zeros(1, actuator_frame(self.plant.axes))
        self.tick = -1
        self.plant.open()

    def step(self, tick: int) -> None:
        """Go on to `tick` with what the drivers have put out. A jump is simulated as if nobody had written since."""
        bench, actuators = self.bench, self._actuators
        for emulator in self._order:
            emulator.drive(tick, bench)
        actuators["command_v"] = np.where(bench.enabled, bench.command_v, 0.0)
        actuators["power"] = bench.enabled.any()
        actuators["array_loaded"] = bench.array_loaded
        self.plant.write(self.tick, actuators)
        self.plant.read(tick, self._sensors)
        self.tick = tick
        self._look()
        for emulator in self._order:
            emulator.sense(tick, bench)

    def inject(self, device: str, fault: str, value: float = 1.0) -> None:
        """Break something of the emulator called `device`; 0 mends it. Raises BackendError."""
        if device not in self.station.emulators:
            raise BackendError("no such device on the bench", value=device, bound=" | ".join(self.station.emulators))
        self.station.emulators[device].inject(fault, value)

    def close(self) -> None:
        """End the plant's session."""
        self.plant.close()

    def _look(self) -> None:
        """What the plant's sensors bear before any electronics judge it."""
        bench, s = self.bench, self._sensors[0]
        self.plant.look(bench.angle_rad, bench.current_a, bench.wrench_in_sensor)
        if s["impedance_sequence"] != bench.impedance_sequence:
            bench.impedance_ohm, bench.impedance_pair = float(s["impedance_ohm"]), int(s["impedance_pair"])
            bench.impedance_sequence = int(s["impedance_sequence"])


def add_emulator(entry: Mapping[str, Any], station: Station) -> Emulator:
    """The double of the device in the table `entry`, plugged into `station`. Raises OptionError, BackendError."""
    table = dict(entry)
    kind, name = table.pop("kind", None), table.pop("name", None)
    if not isinstance(kind, str) or not isinstance(name, str) or name in station.emulators:
        raise OptionError("a device needs a kind and a name of its own", value=[kind, name])
    station.emulators[name] = emulators.load(kind)(name, table, station)
    return station.emulators[name]
