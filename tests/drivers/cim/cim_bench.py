"""The device and its emulator on a switchboard, with a bench whose contacts read what a test says."""

import numpy as np

from drivers.cim.device import CimTelemetry
from hal.device import Readings, Site
from hal.emulator import Bench, Station
from hal.switchboard import Switchboard
from sim_backends.emulators.cim import EmulatedCim

LOCAL, PEER = "127.0.0.1:49300", "127.0.0.1:49301"
PERIOD_S = 0.001
SAMPLE_TICKS = 70
SWEEP_TICKS = 21 * SAMPLE_TICKS


class CimBench:
    """`run` lets ticks pass; `frames` keeps what the device said at each."""

    def __init__(self, **table):
        table = {"local": LOCAL, "peer": PEER, **table}
        self.switchboard = Switchboard()
        self.emulator = EmulatedCim("cim", table, Station(PERIOD_S, 7, self.switchboard))
        self.device = CimTelemetry("cim", table, Site(PERIOD_S, 50, self.switchboard))
        self.bench, self.readings = Bench(4), Readings(4)
        self.pairs = 22 - table.get("pair_step", 1)
        self.noise = np.random.default_rng(3)
        self.ohm = lambda pair, _tick: 2000.0 + 10.0 * pair + self.noise.normal(0.0, 20.0)
        self.tick = 0
        self.device.open()

    def step(self):
        """One tick: the bench measures, the emulator sends, the device reads."""
        if self.tick % SAMPLE_TICKS == 0:
            b = self.bench
            b.impedance_sequence += 1
            b.impedance_pair = (b.impedance_sequence - 1) % self.pairs
            b.impedance_ohm = self.ohm(b.impedance_pair, self.tick)
        self.emulator.sense(self.tick, self.bench)
        self.readings.clear()
        self.device.begin(self.tick)
        self.device.read(self.tick, self.readings)
        self.tick += 1
        return self.readings

    def run(self, ticks):
        """Let ticks pass."""
        for _ in range(ticks):
            self.step()
        return self.readings

    def until(self, condition, limit=20_000):
        """Ticks from now to the first in which `condition(readings)` holds."""
        for n in range(limit):
            if condition(self.step()):
                return n
        raise AssertionError(f"not within {limit} ticks")
