"""A bench in lockstep for devices on an analog card, and the plainest card that keeps the contract of hal.card."""

import math

import numpy as np
import pytest

from hal.device import Demand, Readings, Site
from hal.emulator import Bench, Station
from hal.errors import OptionError
from hal.frames import VALID
from hal.switchboard import Switchboard

COUNTERS, INPUTS, OUTPUTS, LINES = 4, 10, 4, 8
STEP_V = 20 / 65536


class PlainEmulatedCard:
    """The electrical side, with the methods of the emulator of "sensoray526"."""

    def __init__(self):
        self.encoder, self.turn = [0] * COUNTERS, [0] * COUNTERS
        self.index_count, self.index_sequence = [0] * COUNTERS, [0] * COUNTERS
        self.volts, self.outputs = np.zeros(INPUTS), np.zeros(OUTPUTS)
        self.lines_in, self.lines_out, self.expired = [True] * LINES, [False] * LINES, False  # inputs are pulled up

    def set_encoder(self, channel, count):
        old, turn = self.encoder[channel], self.turn[channel]
        self.encoder[channel] = count
        if turn and old // turn != count // turn:
            self.index_count[channel] = max(old, count) // turn * turn
            self.index_sequence[channel] += 1

    def set_index(self, channel, counts_per_turn):
        self.turn[channel] = counts_per_turn

    def set_input(self, channel, voltage_v):
        self.volts[channel] = voltage_v

    def output_v(self, channel):
        return self.outputs[channel]

    def set_line(self, number, high):
        self.lines_in[number] = high

    def line_out(self, number):
        return self.lines_out[number]

    def watchdog_expired(self):
        return self.expired

    def sense(self, tick, bench):
        pass

    drive = sense


class PlainCard:
    """The driver's side: an AnalogCard that samples without error."""

    axes, measures, name = (), frozenset(), "card"

    def __init__(self, emulated):
        self.emulated = emulated
        self.count, self.count_error = np.zeros(COUNTERS, np.int64), np.zeros(COUNTERS, np.bool_)
        self.count_validity, self.count_sequence = np.full(COUNTERS, VALID, np.uint8), 0
        self.index_count, self.index_sequence = np.zeros(COUNTERS, np.int64), np.zeros(COUNTERS, np.int64)
        self.code, self.voltage_v = np.zeros(INPUTS, np.int32), np.zeros(INPUTS)
        self.railed, self.voltage_validity, self.voltage_sequence = np.zeros(INPUTS, np.bool_), VALID, 0
        self.line = np.ones(LINES, np.bool_)
        self.claims, self.silent = set(), False
        self._put = []

    def _claim(self, what, number, most, who):
        if number >= most or (what, number) in self.claims:
            raise OptionError(f"{who} cannot have {what} {number}")
        self.claims.add((what, number))

    def use_counter(self, channel, who):
        self._claim("counter", channel, COUNTERS, who)

    def use_input(self, channel, who):
        self._claim("input", channel, INPUTS, who)

    def use_output(self, channel, who):
        self._claim("output", channel, OUTPUTS, who)

    def use_line(self, number, who, *, output):  # noqa: ARG002
        self._claim("line", number, LINES, who)

    def put_voltage(self, channel, voltage_v):
        assert math.isfinite(voltage_v)
        self._put.append((self.emulated.outputs, channel, min(max(voltage_v, -10.0), 10.0)))

    def put_line(self, number, high):
        self._put.append((self.emulated.lines_out, number, high))

    def open(self):
        pass

    def begin(self, tick):
        pass

    def read(self, tick, readings):  # noqa: ARG002
        e = self.emulated
        self.index_count[:], self.index_sequence[:], self.line[:] = e.index_count, e.index_sequence, e.lines_in
        if not self.silent:
            self.count[:] = e.encoder
            self.count_sequence += 1
            self.code[:] = np.clip(np.round(e.volts / STEP_V), -32768, 32767)
            self.voltage_v[:] = self.code * STEP_V
            self.railed[:] = abs(self.code) >= 0.995 * 32768
            self.voltage_sequence += 1

    def write(self, tick, demand):  # noqa: ARG002
        for where, number, value in self._put:
            where[number] = value
        self._put.clear()

    def close(self):
        self.write(0, None)


class Lockstep:
    """Devices, their emulators and a bench, tick by tick in the order of drivers/backend.py.

    `physics(bench)`, if set, moves the bench between two ticks.
    """

    def __init__(self, *, axes=1, card=True, period_s=0.001):
        self.switchboard = Switchboard()
        self.site = Site(period_s, 50, self.switchboard)
        self.station = Station(period_s, 1, self.switchboard)
        self.bench, self.readings, self.demand = Bench(axes), Readings(axes), Demand(axes)
        self.tick, self.physics, self.opened = 0, None, False
        if card:
            self.station.emulators["card"] = PlainEmulatedCard()
            self.site.devices["card"] = PlainCard(self.station.emulators["card"])

    def add(self, device, emulator, name, table):
        """Make both ends of a device; returns them."""
        self.station.emulators[name] = emulator(name, table, self.station)
        self.site.devices[name] = device(name, table, self.site)
        return self.site.devices[name], self.station.emulators[name]

    def step(self, command_v=0.0, power=False, *, skip=0):
        """One tick (after `skip` missed ones); returns the readings before the command."""
        for _ in range(skip + 1):
            self.tick += 1
            if self.physics is not None:
                self.physics(self.bench)
            for emulator in self.station.emulators.values():
                emulator.sense(self.tick, self.bench)
        if not self.opened:
            self.opened = True
            for device in self.site.devices.values():
                device.open()
        self.readings.clear()
        devices = list(self.site.devices.values())
        for device in devices:
            device.begin(self.tick)
        for number, device in enumerate(devices):
            self.readings.device = number
            device.read(self.tick, self.readings)
        self.demand.clear_faults = self.demand.power and not power
        self.demand.power = power
        self.demand.command_v[:] = command_v if power else 0.0
        for device in devices[::-1]:
            device.write(self.tick, self.demand)
        for emulator in self.station.emulators.values():
            emulator.drive(self.tick, self.bench)
        return self.readings

    def steps(self, count, command_v=0.0, power=False):
        """Several ticks; the troubles that were reported, as a set."""
        return {self.step(command_v, power).trouble for _ in range(count)}

    def until(self, what, command_v=0.0, power=False, most=2000):
        """Ticks until `what(readings)` is true."""
        for count in range(1, most + 1):
            if what(self.step(command_v, power)):
                return count
        raise AssertionError(f"not within {most} ticks")


@pytest.fixture(scope="session")
def lockstep():
    """The class, to make benches of."""
    return Lockstep
