"""Links between the processes of an emulated bench: what goes in comes out, and what nobody fetches hinders nobody."""

import contextlib
import os

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.errors import BackendError
from hal.sockets import SerialPort
from sim_backends.emulators.epos_can import LockstepBus
from sim_backends.rig.can_socket import CanOutlet, CanSocket
from sim_backends.rig.links import RealLinks, can_path, serial_path
from sim_backends.rig.seams import RigSeams

PERIOD_S = 0.001


@pytest.fixture
def place():
    return f"links-{os.getpid()}"


def message(identifier, data=b""):
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=data)


class Bus:
    """Both ends of a bus, and the emulated drives behind it."""

    def __init__(self, path):
        self.emulated = LockstepBus("can0", 1_000_000)
        self.outlet = CanOutlet(path, self.emulated)
        self.driver = CanSocket(path)

    def tick(self):
        self.outlet.fetch()
        self.emulated.let_pass(PERIOD_S)
        self.outlet.deliver()


@pytest.fixture(scope="module")
def bus(tmp_path_factory):
    bus = Bus(tmp_path_factory.mktemp("bus") / "can")
    yield bus
    bus.driver.shutdown()


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_a_frame_is_the_same_at_the_other_end(bus, identifier, data):
    heard = []

    class Drive:
        outgoing = []  # noqa: RUF012
        hears = frozenset(range(0x800))

        def hear(self, identifier, data):
            heard.append((identifier, bytes(data)))

    bus.emulated.participants[:] = [Drive()]
    bus.driver.send(message(identifier, data))
    bus.tick()
    assert heard == [(identifier, data)]


def test_answers_and_errors_of_the_bus_reach_the_driver(bus):
    assert bus.driver.recv(0.0) is None
    bus.emulated.raise_error(0x40)
    bus.emulated._incoming.append(message(0x181, b"\1\2\3"))
    bus.tick()
    first, second = bus.driver.recv(0.5), bus.driver.recv(0.5)
    assert (first.arbitration_id, first.is_error_frame) == (0x40, True)
    assert (second.arbitration_id, bytes(second.data), second.is_error_frame) == (0x181, b"\1\2\3", False)
    assert bus.driver.recv(0.0) is None


def test_a_driver_that_does_not_fetch_loses_frames_and_holds_nobody_up(bus):
    for _ in range(50):
        for _ in range(1000):
            bus.emulated._incoming.append(message(0x181))
        bus.tick()
    assert not bus.emulated._incoming
    while bus.driver.recv(0.0) is not None:
        pass


def test_a_bench_that_does_not_fetch_is_a_full_queue(tmp_path):
    bus = Bus(tmp_path / "can")
    sent = 0
    with contextlib.suppress(can.CanOperationError):
        while sent < 100_000:
            bus.driver.send(message(1))
            sent += 1
    assert 0 < sent < 100_000
    bus.driver.shutdown()


def test_the_next_driver_takes_the_place_of_the_last(tmp_path):
    bus = Bus(tmp_path / "can")
    bus.tick()
    bus.driver.shutdown()
    second = CanSocket(tmp_path / "can")
    bus.tick()
    bus.emulated._incoming.append(message(5))
    bus.tick()
    assert second.recv(0.5).arbitration_id == 5
    second.shutdown()


def test_without_a_bench_the_driver_says_what_to_start(place):
    with pytest.raises(BackendError, match=r"no such CAN bus.*rtctl bench rig"):
        RigSeams(place).can_bus("socketcan", "can0", 1_000_000)
    with pytest.raises(BackendError, match="serial port"):
        RigSeams(place).serial("/dev/ttyS0", 38400)


def test_a_serial_line_carries_every_byte_both_ways(place):
    links = RealLinks(place)
    device = links.plug_serial("/dev/ttyS0")
    port = RigSeams(place).serial("/dev/ttyS0", 38400)
    assert isinstance(port, SerialPort)
    buffer = bytearray(1000)
    assert device.receive(buffer) == port.receive(buffer) == -1
    every = bytes(range(256))
    port.send(every)
    device.send(every[::-1])
    assert device.receive(buffer) == 256
    assert buffer[:256] == every, "raw: no byte means anything to the terminal"
    assert port.receive(buffer) == 256
    assert buffer[:256] == every[::-1]
    port.close()
    device.send(b"nobody listens")
    device.close()
    links.remove()
    assert not serial_path(place, "/dev/ttyS0").is_symlink()


def test_names_are_taken_away_with_the_bench(place):
    links = RealLinks(place)
    links.plug_bus("can0", LockstepBus("can0", 1_000_000))
    assert can_path(place, "can0").exists()
    links.remove()
    assert not can_path(place, "can0").exists()
