"""What an exchange with five EPOS drives costs at 500 Hz, on the bus in lockstep: the driver, the bus, the drives' frames."""

import gc
import time
from typing import Any

import numpy as np

from bench.figures import Figure, Target
from drivers.epos.device import EposBus
from hal.device import Demand, Readings, Site
from hal.emulator import Bench, Station
from hal.switchboard import Switchboard
from sim_backends.emulators.epos import EmulatedEposBus

PART = "epos"
TARGET = Target(100.0)
AXES, DIVISOR, PERIOD_S = 5, 2, 1e-3
WARM_UP, EXCHANGES = 100, 3000
TABLE: dict[str, Any] = {
    "channel": "bench",
    "divisor": DIVISOR,
    "nodes": [
        {
            "node": axis + 1, "axis": axis, "mode": "cst", "counts_per_rad": 4000 / (2 * np.pi), "gain_a_per_v": 0.1,
            "rated_current_a": 0.8, "current_limit_a": 1.6, "max_speed_rad_per_s": 400.0, "following_error_rad": 2.0,
            "quick_stop_rad_per_s2": 4000.0,
        }
        for axis in range(AXES)
    ],
}  # fmt: skip


def measure() -> list[Figure]:
    """Microseconds of one exchange: median, and 99th percentile.

    Raises:
        OptionError, BackendError: the drives cannot be set up.
    """
    whole_us, driver_us = _measured_us()
    note = f"{AXES} axes CST at {1 / (DIVISOR * PERIOD_S):.0f} Hz, {2 * AXES + 1} frames; {EXCHANGES} exchanges"
    return [
        Figure(PART, "exchange", "us", float(np.median(whole_us)), target=TARGET, note=note),
        Figure(PART, "exchange, 99 %", "us", float(np.percentile(whole_us, 99)), note="with the lock-step bus"),
        Figure(PART, "driver of it", "us", float(np.median(driver_us)), note="read and write of its ticks"),
    ]


def _measured_us() -> tuple[np.ndarray, np.ndarray]:
    """Of every exchange, (EXCHANGES,): driver with bus, and the driver's share. The motors' physics are not counted."""
    station = Station(PERIOD_S, 1, Switchboard())
    emulator = EmulatedEposBus("bus", TABLE, station)
    device = EposBus("bus", TABLE, Site(PERIOD_S, 50, station.switchboard))
    bench, readings, demand = Bench(AXES), Readings(AXES), Demand(AXES)
    device.open()
    demand.power = True
    demand.command_v[:] = np.linspace(-1.0, 1.0, AXES)
    driver_s, bus_s = np.zeros((2, WARM_UP + EXCHANGES))
    gc.collect()
    gc.disable()
    try:
        for tick in range((WARM_UP + EXCHANGES) * DIVISOR):
            emulator.sense(tick, bench)
            readings.clear()
            start = time.perf_counter()
            device.begin(tick)
            device.read(tick, readings)
            device.write(tick, demand)
            middle = time.perf_counter()
            emulator.bus.let_pass(PERIOD_S)
            end = time.perf_counter()
            for node in emulator.nodes.values():
                node.advance(PERIOD_S)
            driver_s[tick // DIVISOR] += middle - start
            bus_s[tick // DIVISOR] += end - middle
    finally:
        gc.enable()
        device.close()
    driver_us = driver_s[WARM_UP:] * 1e6
    return driver_us + bus_s[WARM_UP:] * 1e6, driver_us
