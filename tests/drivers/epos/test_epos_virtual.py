"""The same driver on a bus of python-can that knows nothing of ticks: `virtual`, the drives in a thread of their own."""

import itertools
import threading
from types import SimpleNamespace

import can
import numpy as np
import pytest

from drivers.epos.device import EposBus
from hal.device import Demand, Readings, Site
from hal.emulator import Bench, Station
from hal.errors import BackendError
from hal.frames import VALID
from hal.switchboard import Switchboard
from hal.troubles import Trouble
from sim_backends.emulators.epos import EmulatedEposBus
from sim_backends.emulators.epos_relay import Relay

PERIOD_S = 1e-3
CHANNELS = itertools.count()


class VirtualSeams(Switchboard):
    """CAN by python-can, as on a target PC."""

    def can_bus(self, interface, channel, bitrate):
        return can.Bus(interface=interface, channel=channel, bitrate=bitrate)


class Drives:
    """Emulated drives that live in a thread: a period goes by when the loop has done a tick, or when it waits."""

    def __init__(self, table):
        self.emulator = EmulatedEposBus("bus", table, Station(PERIOD_S, 1, Switchboard()))
        self._bus = can.Bus(interface="virtual", channel=table["channel"])
        self._relay, self.bench = Relay(self.emulator, self._bus), Bench(len(table["nodes"]))
        self._go, self._done, self._stop = threading.Event(), threading.Event(), False
        self._thread = threading.Thread(target=self._live)
        self._thread.start()

    def _live(self):
        for tick in itertools.count():
            asked = self._go.wait(PERIOD_S)
            if asked:
                self._go.clear()
            if self._stop:
                return
            self._relay.step(tick, self.bench)
            if asked:
                self._done.set()

    def period(self):
        """Let one period go by."""
        self._done.clear()
        self._go.set()
        self._done.wait(5.0)

    def end(self):
        """Of the thread."""
        self._stop = True
        self._thread.join()
        self._bus.shutdown()


@pytest.fixture
def line(rig):
    """A driver and its drives on a channel of their own."""
    nodes = [rig.node(i + 1, i, mode) for i, mode in enumerate(("csp", "cst", "velocity"))]
    table = rig.bus(*nodes, channel=f"line-{next(CHANNELS)}", interface="virtual")
    drives = Drives(table)
    device = EposBus("bus", table, Site(PERIOD_S, 50, VirtualSeams()))
    found = SimpleNamespace(drives=drives, device=device, readings=Readings(3), demand=Demand(3))

    def run(first, ticks):
        for tick in range(first, first + ticks):
            found.readings.clear()
            device.read(tick, found.readings)
            device.write(tick, found.demand)
            drives.period()

    found.run = run
    yield found
    device.close()
    drives.end()


def test_drives_are_opened_armed_and_moved(line):
    line.device.open()
    line.demand.clear_faults = True
    line.run(0, 1)
    line.demand.clear_faults, line.demand.power = False, True
    line.run(1, 60)
    assert line.readings.axis_powered.all()
    line.demand.command_v[:] = 1.0
    line.run(61, 200)
    assert line.readings.trouble == Trouble.NONE
    assert (line.readings.axis_validity == VALID).all()
    assert line.readings.axis_angle_rad[[0, 2]] == pytest.approx([2.0, 2.0], rel=0.1)
    line.device.close()
    line.drives.period()
    line.drives.period()
    assert not any(node.drive.state.name == "ENABLED" for node in line.drives.emulator.nodes.values())


def test_an_error_frame_passes_such_a_bus_intact(line):
    line.device.open()
    line.run(0, 10)
    line.drives.emulator.bus.raise_error(0x04, 0x20)
    line.run(10, 4)
    assert line.readings.trouble == Trouble.BUS_PASSIVE
    line.drives.emulator.bus.raise_error(0x40)
    line.run(14, 4)
    assert line.readings.trouble == Trouble.BUS_OFF
    assert np.isnan(line.readings.axis_angle_rad).all()


def test_nobody_on_the_bus(rig):
    table = rig.bus(rig.node(1, 0), channel=f"line-{next(CHANNELS)}", interface="virtual")
    device = EposBus("bus", table, Site(PERIOD_S, 50, VirtualSeams()))
    with pytest.raises(BackendError, match=r"does not answer.*node 1.*termination"):
        device.open()
    device.close()
