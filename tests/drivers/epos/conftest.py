"""Drives on the emulated bus behind the hardware backend, one call a tick."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.backend import HardwareBackend
from hal.emulator import Bench, Station
from hal.frames import actuator_frame, sensor_frame
from hal.switchboard import Switchboard
from hal.troubles import Trouble
from sim_backends.emulators.epos import EmulatedEposBus

CPR = 4000 / (2 * np.pi)
COMMON = {
    "counts_per_rad": CPR, "rated_current_a": 0.8, "current_limit_a": 1.6, "max_speed_rad_per_s": 400.0,
    "following_error_rad": 2.0, "quick_stop_rad_per_s2": 4000.0,
}  # fmt: skip


def node(number, axis, mode="cst", **more):
    """Table of a drive."""
    gain = {"gain_a_per_v": 0.1} if mode in ("cst", "current") else {"gain_rad_per_s_per_v": 10.0}
    generation = "epos2" if mode in ("position", "velocity", "current") else "epos4"
    return {"node": number, "axis": axis, "mode": mode, "generation": generation, **COMMON, **gain, **more}


def bus(*nodes, channel="can0", **more):
    """Table of a bus."""
    return {"channel": channel, "nodes": list(nodes), **more}


class Rig:
    """A hardware backend with emulated buses around a rotor for each axis in a torque mode."""

    period_s = 1e-3

    def __init__(self, *tables, open_it=True):
        self.station = Station(self.period_s, 1, Switchboard())
        self.emulators = [EmulatedEposBus(f"bus{i}", copy.deepcopy(t), self.station) for i, t in enumerate(tables)]
        entries = [{"kind": "epos_bus", "name": f"bus{i}", **t} for i, t in enumerate(tables)]
        self.backend = HardwareBackend({"devices": entries}, period_s=self.period_s)
        self.backend.use(self.station.switchboard)
        self.bench = Bench(self.backend.axes)
        self.sensors, self.actuators = (np.zeros(1, frame(self.backend.axes)) for frame in (sensor_frame, actuator_frame))  # fmt: skip
        self.rate = np.zeros(self.backend.axes)
        self.tick = 0
        self.device = next(iter(self.backend.devices.values()))
        self.emulator = self.emulators[0]
        if open_it:
            self.backend.open()

    def node(self, number):
        """The emulated drive."""
        return next(e.nodes[number] for e in self.emulators if number in e.nodes)

    def step(self, command_v=0.0, power=1, write=True):
        """One tick of everybody; returns the sensor frame."""
        for emulator in self.emulators:
            emulator.sense(self.tick, self.bench)
        if write is not None:
            self.backend.read(self.tick, self.sensors)
        if write:
            self.actuators["command_v"], self.actuators["power"] = command_v, power
            self.backend.write(self.tick, self.actuators)
        for emulator in self.emulators:
            emulator.drive(self.tick, self.bench)
        current = np.where(self.bench.enabled, 0.1 * self.bench.command_v, 0.0)
        self.bench.current_a[:] = current
        self.rate += (current * 0.025 - 1e-5 * self.rate) / 2e-5 * self.period_s
        self.bench.angle_rad += self.rate * self.period_s
        self.tick += 1
        return self.sensors[0]

    def run(self, ticks, command_v=0.0, power=1):
        """Many ticks."""
        for _ in range(ticks):
            self.step(command_v, power)
        return self.sensors[0]

    def power_up(self, limit=60):
        """Until all axes have power; ticks it took."""
        self.step(power=0)
        for n in range(limit):
            if self.step()["powered"]:
                return n
        raise AssertionError("no power")

    def until(self, trouble, limit=200, command_v=0.0):
        """Ticks until a trouble is reported."""
        for n in range(1, limit + 1):
            if self.step(command_v)["trouble"] == trouble:
                return n
        raise AssertionError(f"no {Trouble(trouble).name}, but {self.sensors[0]['trouble']}")


@pytest.fixture(scope="session")
def rig():
    """Makes rigs and tables."""
    return SimpleNamespace(make=Rig, node=node, bus=bus, cpr=CPR)
