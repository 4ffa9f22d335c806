"""The emulated drive as a client sees it that knows nothing of ours: canopen's own node of CiA 402."""

import itertools
import threading
import time

import can
import canopen
import numpy as np
import pytest
from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable, datatypes
from canopen.profiles.p402 import BaseNode402

from hal.emulator import Bench, Station
from hal.switchboard import Switchboard
from sim_backends.emulators.epos import EmulatedEposBus
from sim_backends.emulators.epos_relay import Relay

NODE = 5
CHANNELS = itertools.count()
TABLE = {"channel": "x", "nodes": [{"node": NODE, "axis": 0, "counts_per_rad": 4000 / (2 * np.pi)}]}
TYPES = {1: datatypes.UNSIGNED8, 2: datatypes.UNSIGNED16, 4: datatypes.UNSIGNED32}


def variable(index, sub, size, signed=False):
    found = ODVariable(f"{index:04X}:{sub}", index, sub)
    found.data_type = {1: datatypes.INTEGER8, 2: datatypes.INTEGER16, 4: datatypes.INTEGER32}[size] if signed else TYPES[size]  # fmt: skip
    return found


def dictionary():
    """What an EDS of the drive would say, as far as this client asks."""
    found = ObjectDictionary()
    for index, size, signed in ((0x6040, 2, False), (0x6041, 2, False), (0x6060, 1, True), (0x6061, 1, True), (0x6064, 4, True), (0x6502, 4, False), (0x607A, 4, True), (0x1001, 1, False), (0x603F, 2, False)):  # fmt: skip
        found.add_object(variable(index, 0, size, signed))
    for communication, mapping in ((0x1400, 0x1600), (0x1401, 0x1601), (0x1800, 0x1A00), (0x1801, 0x1A01)):
        record = ODRecord(f"{communication:04X}", communication)
        for sub, size in ((0, 1), (1, 4), (2, 1)):
            record.add_member(variable(communication, sub, size))
        found.add_object(record)
        record = ODRecord(f"{mapping:04X}", mapping)
        for sub in range(9):
            record.add_member(variable(mapping, sub, 4 if sub else 1))
        found.add_object(record)
    return found


@pytest.fixture
def drive():
    """The client's node, and the emulator that answers from a thread."""
    channel = f"epos-{next(CHANNELS)}"
    emulator = EmulatedEposBus("bus", TABLE, Station(1e-3, 1, Switchboard()))
    device_end = can.Bus(interface="virtual", channel=channel)
    relay, bench, stop = Relay(emulator, device_end), Bench(1), threading.Event()

    def live():
        for tick in itertools.count():
            if stop.wait(1e-3):
                return
            relay.step(tick, bench)

    thread = threading.Thread(target=live)
    thread.start()
    network = canopen.Network()
    network.connect(interface="virtual", channel=channel)
    node = BaseNode402(NODE, dictionary())
    network.add_node(node)
    try:
        yield node, emulator
    finally:
        network.disconnect()
        stop.set()
        thread.join()
        device_end.shutdown()


def configure(node):
    """Controlword and target by RPDO, statusword and position by TPDO, all asynchronous: what this client can do."""
    node.nmt.state = "PRE-OPERATIONAL"
    for pdo, names in ((node.rpdo[1], (0x6040, 0x607A)), (node.tpdo[1], (0x6041, 0x6064))):
        pdo.read()
        pdo.clear()
        for index in names:
            pdo.add_variable(index)
        pdo.trans_type, pdo.enabled = 255, True
        pdo.save()
    node.setup_402_state_machine()
    node.nmt.state = "OPERATIONAL"
    node.tpdo[1].wait_for_reception(timeout=2.0)


def test_it_walks_through_the_state_machine_for_a_strange_client(drive):
    node, emulator = drive
    configure(node)
    assert node.state == "SWITCH ON DISABLED"
    for state in ("READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"):
        node.state = state
        assert node.state == state
    assert emulator.nodes[NODE].drive.power_stage
    node.state = "SWITCH ON DISABLED"
    assert not emulator.nodes[NODE].drive.power_stage


def test_its_profile_position_mode_takes_a_strange_client_to_its_target(drive):
    node, emulator = drive
    configure(node)
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    node.rpdo_pointers[0x607A].raw = 300
    node.controlword = 0x0F
    node.controlword = 0x3F
    deadline = time.monotonic() + 5.0
    while abs(node.sdo[0x6064].raw - 300) > 3 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert abs(node.sdo[0x6064].raw - 300) <= 3
    assert emulator.nodes[NODE].drive.loops.rotor.angle_rad * 4000 / (2 * np.pi) == pytest.approx(300, abs=15)


def test_a_fault_reaches_a_strange_client_with_its_emergency(drive):
    node, emulator = drive
    configure(node)
    node.state = "OPERATION ENABLED"
    emulator.inject("drive_fault", NODE)
    assert node.emcy.wait(0x2310, timeout=2.0).register == 3
    deadline = time.monotonic() + 2.0
    while node.state != "FAULT" and time.monotonic() < deadline:
        time.sleep(0.01)
    assert node.state == "FAULT"
    assert node.sdo[0x603F].raw == 0x2310


def test_heartbeat_and_nmt_are_understood(drive):
    node, _ = drive
    node.sdo.download(0x1017, 0, (10).to_bytes(2, "little"))
    assert node.nmt.wait_for_heartbeat(timeout=2.0) == "PRE-OPERATIONAL"
    node.nmt.send_command(0x01)
    time.sleep(0.05)
    assert node.nmt.wait_for_heartbeat(timeout=2.0) == "OPERATIONAL"
    node.nmt.send_command(0x81)
    node.nmt.wait_for_bootup(timeout=2.0)


@pytest.mark.parametrize(
    ("index", "sub", "data", "code"),
    [
        (0x2FFF, 0, b"\0", 0x06020000),
        (0x607D, 7, b"\0\0\0\0", 0x06090011),
        (0x6041, 0, b"\0\0", 0x06010002),
        (0x6065, 0, b"\0\0", 0x06070010),
        (0x6060, 0, b"\xff", 0x06090030),
        (0x1600, 1, b"\x10\0\x40\x60", 0x08000022),
    ],
)
def test_sdo_transfers_are_refused_with_the_right_code(drive, index, sub, data, code):
    node, _ = drive
    with pytest.raises(canopen.SdoAbortedError) as refused:
        node.sdo.download(index, sub, data)
    assert refused.value.code == code
