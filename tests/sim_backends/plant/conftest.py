"""A bench one can drive in a line."""

import numpy as np
import pytest

from hal.frames import actuator_frame, sensor_frame
from sim_backends.plant.backend import PlantBackend
from sim_backends.plant.state import AXES


class Drive:
    """An opened plant with its frames; one call of `run` is many ticks."""

    def __init__(self, table=None, seed=1):
        self.backend = PlantBackend(table or {}, period_s=0.001, seed=seed)
        self.device = self.backend.compiled().device[0]
        self.truth = self.backend.truth()[1][0]
        self.sensors, self.actuators = np.zeros(1, sensor_frame(AXES)), np.zeros(1, actuator_frame(AXES))
        self.tick = 0
        self.backend.open()
        self.read()

    def read(self, tick=None):
        self.tick = self.tick if tick is None else tick
        self.backend.read(self.tick, self.sensors)
        return self.sensors[0]

    def run(self, ticks, command_v=0.0, power=1):
        """Write, then read at the next tick; returns the last sensor record."""
        self.actuators["command_v"], self.actuators["power"] = command_v, power
        for _ in range(ticks):
            self.backend.write(self.tick, self.actuators)
            self.read(self.tick + 1)
        return self.sensors[0]

    def load_array(self, loaded=1):
        self.actuators["array_loaded"] = loaded


@pytest.fixture
def drive():
    return Drive
