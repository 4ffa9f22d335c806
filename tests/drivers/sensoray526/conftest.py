"""A driver of the card and an emulated card, wired in memory, that a test can drive tick by tick."""

from collections.abc import Callable
from typing import Any

import pytest

from drivers.sensoray526.device import Sensoray526
from hal.device import Demand, Readings, Site
from hal.emulator import Bench, Station
from hal.seams import PortIO
from hal.switchboard import Switchboard
from hal.troubles import Trouble
from sim_backends.emulators.sensoray526 import CardPorts, EmulatedSensoray526

BASE = 0x300
PERIOD_S = 0.001
GAUGES = range(6)


class CardRig:
    """An opened card with four counters, six inputs, four outputs, lines 0-3 out and 4-7 in."""

    def __init__(
        self, wrap: Callable[[PortIO], PortIO] = lambda ports: ports, opened: bool = True, **table: Any
    ) -> None:
        table = {"base": BASE, **table}
        self.board = Switchboard()
        self.emulated = EmulatedSensoray526("card", table, Station(PERIOD_S, 1, self.board))
        self.card = Sensoray526("card", table, Site(PERIOD_S, 50, self.board))
        self.board.plug_ports(BASE, wrap(CardPorts(self.emulated.record)))
        for channel in range(4):
            self.card.use_counter(channel, "axis")
            self.card.use_output(channel, "axis")
            self.card.use_line(channel, "axis", output=True)
            if table.get("watchdog_line") != 4 + channel:
                self.card.use_line(4 + channel, "axis", output=False)
        for channel in GAUGES:
            self.card.use_input(channel, "sensor")
        self.readings, self.demand, self.bench, self.now = Readings(0), Demand(0), Bench(0), 0
        self.demand.clear_faults = True
        if opened:
            self.card.open()

    def sense(self) -> Readings:
        """A tick up to what the devices measured."""
        self.now += 1
        self.emulated.sense(self.now, self.bench)
        self.readings.clear()
        self.card.begin(self.now)
        self.card.read(self.now, self.readings)
        return self.readings

    def tick(self) -> Readings:
        """A whole tick."""
        self.sense()
        self.card.write(self.now, self.demand)
        self.demand.clear_faults = False
        return self.readings

    @property
    def trouble(self) -> Trouble:
        return Trouble(self.readings.trouble)


@pytest.fixture(scope="session")
def make_card_rig() -> Callable[..., CardRig]:
    return CardRig


@pytest.fixture
def rig() -> CardRig:
    return CardRig()
