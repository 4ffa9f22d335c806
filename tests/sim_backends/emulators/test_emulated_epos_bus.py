"""The bus in lockstep: what fits into a tick, in which order, and what does not."""

from collections import deque

import can
import numpy as np
import pytest

from hal.emulator import Bench, Station
from hal.errors import BackendError
from hal.switchboard import Switchboard
from sim_backends.emulators.epos import EmulatedEposBus
from sim_backends.emulators.epos_can import QUEUE, LockstepBus, stuffed_bits


class Listener:
    """Answers every SYNC with `size` bytes under its own identifier."""

    def __init__(self, number, size=6):
        self.outgoing, self.hears, self.heard = deque(), {0x80, 0x200 + number}, []
        self.number, self.size = number, size

    def hear(self, identifier, data):
        self.heard.append((identifier, data))
        if identifier == 0x80:
            self.outgoing.append((0x180 + self.number, bytes(self.size)))


def frame(identifier, size=0):
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=bytes(size))


def bus_with(count, size=6):
    bus = LockstepBus("x", 1_000_000)
    listeners = [Listener(i + 1, size) for i in range(count)]
    for listener in listeners:
        bus.join(listener)
    return bus, listeners


def drain(bus):
    return [m.arbitration_id for m in iter(lambda: bus.recv(0.0), None)]


@pytest.mark.parametrize(("data_bytes", "bits"), [(0, 55), (2, 75), (4, 95), (6, 115), (7, 125), (8, 135)])
def test_a_frame_is_charged_with_worst_case_stuffing(data_bytes, bits):
    assert stuffed_bits(data_bytes) == bits  # 07 section 2.4
    bus, _ = bus_with(1)
    bus.send(frame(0x201, data_bytes))
    bus.let_pass((bits - 1) * 1e-6)
    assert bus.left_over == 1
    bus.let_pass(1.01e-6)
    assert bus.left_over == 0


def test_an_idle_bus_saves_no_time_up():
    bus, listeners = bus_with(1)
    bus.let_pass(1.0)
    bus.send(frame(0x80))
    assert not listeners[0].heard
    bus.let_pass(50e-6)
    assert not listeners[0].heard
    bus.let_pass(6e-6)
    assert listeners[0].heard == [(0x80, b"")]


def test_the_lowest_identifier_wins_between_queues_and_order_holds_within_one():
    bus, _ = bus_with(3)
    for identifier in (0x80, 0x201, 0x202):
        bus.send(frame(identifier, 6 if identifier > 0x80 else 0))
    bus.let_pass(1e-3)
    assert drain(bus) == [0x181, 0x182, 0x183]
    bus.send(frame(0x202, 6))
    bus.send(frame(0x80))
    bus.let_pass(115e-6)
    assert bus.left_over == 1  # the SYNC waits behind the set value, as in a transmit queue


def exchange(bus, count, size):
    for i in range(count):
        bus.send(frame(0x201 + i, size))
    bus.send(frame(0x80))


@pytest.mark.parametrize(("axes", "divisor", "fits"), [(5, 1, False), (5, 2, True), (3, 1, True), (2, 1, True)])
def test_a_layout_that_does_not_fit_falls_behind(axes, divisor, fits):
    """07 section 2.4: five axes of 6 + 6 bytes need 1205 bits a tick of 1000."""
    bus, _ = bus_with(axes)
    for tick in range(60):
        if tick % divisor == 0:
            exchange(bus, axes, 6)
        bus.let_pass(1e-3)
    answers = len(drain(bus))
    assert (bus.left_over == 0) == fits
    assert (answers == 60 // divisor * axes) == fits


def overload(bus):
    for _ in range(1000):
        exchange(bus, 5, 6)
        bus.let_pass(1e-3)


def test_an_overloaded_bus_fills_the_transmit_queue_in_the_end():
    bus, _ = bus_with(5)
    with pytest.raises(can.CanOperationError, match="buffer full"):
        overload(bus)
    assert bus.left_over >= QUEUE - 6


def test_waiting_lets_time_pass_and_asking_does_not():
    bus, _ = bus_with(1)
    bus.send(frame(0x80))
    assert bus.recv(0.0) is None
    assert bus.recv(0.3).arbitration_id == 0x181


def test_frames_that_no_drive_understands_are_an_error():
    bus, _ = bus_with(1)
    with pytest.raises(ValueError, match="no drive"):
        bus.send(can.Message(arbitration_id=0x201, is_extended_id=True))


def emulator(**entry):
    table = {"channel": "x", "nodes": [{"node": 3, "axis": 0, "counts_per_rad": 4000 / (2 * np.pi), **entry}]}
    return EmulatedEposBus("bus", table, Station(1e-3, 1, Switchboard()))


def test_a_fault_that_is_not_known_is_an_error():
    with pytest.raises(BackendError, match="no such fault"):
        emulator().inject("flood")


def test_an_axis_that_the_bench_does_not_have_turns_a_motor_of_the_drive():
    double = emulator()
    double.nodes[3].drive.loops._mode.value = 10
    bench = Bench(0)
    double.sense(0, bench)
    double.drive(0, bench)
    assert not double.nodes[3].drive.loops.turns_bench


def test_a_frame_received_is_a_message_of_python_can():
    bus, _ = bus_with(1)
    bus.send(frame(0x80))
    received = bus.recv(0.1)
    assert received.equals(can.Message(arbitration_id=0x181, is_extended_id=False, data=bytes(6)), timestamp_delta=None)
    assert str(received)
