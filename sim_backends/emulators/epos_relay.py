"""Emulated drives on a bus of python-can that is real to the driver: `virtual` in one process, `vcan` between two."""

from typing import Any

import can

from hal.emulator import Bench
from sim_backends.emulators.epos import EmulatedEposBus


class Relay:
    """Carries frames between the bus in lockstep and `bus`, once a tick; whoever calls it has the clock."""

    def __init__(self, emulator: EmulatedEposBus, bus: Any) -> None:
        self._emulator, self._bus = emulator, bus

    def step(self, tick: int, bench: Bench) -> None:
        """One period: what the driver sent reaches the drives, and what they answer goes out."""
        while (message := self._bus.recv(0.0)) is not None:
            try:
                self._emulator.bus.send(message)
            except (can.CanError, ValueError):
                break  # a bus that is off, or a frame that no drive understands
        self._emulator.drive(tick, bench)
        self._emulator.sense(tick, bench)
        while (answer := self._emulator.bus.recv(0.0)) is not None:
            self._bus.send(answer)
