"""A mapping that is changed in the wrong order, at the wrong time or beyond eight bytes is refused (07 section 2.3)."""

import struct

import pytest

from sim_backends.emulators.epos_node import Node
from sim_backends.emulators.epos_objects import ABORT_NOT_MAPPABLE, ABORT_PDO_LENGTH, ABORT_STATE

NODE, INVALID = 4, 1 << 31


def write(node, index, sub, value):
    """Abort code of an SDO download, 0 for none."""
    code = "I" if (index & 0x200 and sub) or sub == 1 else "B"
    data = struct.pack("<" + code, value)
    command = 0x23 | 4 - len(data) << 2
    node.outgoing.clear()
    node.hear(0x600 + NODE, struct.pack("<BHB4s", command, index, sub, data))
    identifier, reply = node.outgoing.popleft()
    assert identifier == 0x580 + NODE
    return struct.unpack_from("<I", reply, 4)[0] if reply[0] == 0x80 else 0


def node(operational=False):
    made = Node(NODE, "epos4")
    if operational:
        made.hear(0, bytes((1, NODE)))
    return made


RIGHT = [
    (0x1400, 1, 0x204 | INVALID), (0x1600, 0, 0), (0x1600, 1, 0x60400010), (0x1600, 2, 0x60710010), (0x1600, 0, 2),
    (0x1400, 2, 1), (0x1400, 1, 0x204),
]  # fmt: skip


def test_the_right_order_works_and_takes_effect_at_the_next_sync():
    drive = node()
    assert [write(drive, *step) for step in RIGHT] == [0] * len(RIGHT)
    drive.hear(0, bytes((1, NODE)))
    drive.hear(0x204, struct.pack("<Hh", 6, 250))
    assert drive._objects[0x607100].value == 0
    drive.hear(0x80, b"")
    assert (drive._objects[0x604000].value, drive._objects[0x607100].value) == (6, 250)


@pytest.mark.parametrize("left_out", [0, 1])
def test_a_step_left_out_is_refused(left_out):
    drive = node()
    codes = [write(drive, *step) for i, step in enumerate(RIGHT) if i != left_out]
    assert ABORT_STATE in codes


def test_nothing_is_remapped_in_operation():
    drive = node(operational=True)
    assert {write(drive, *step) for step in RIGHT} == {ABORT_STATE}


def test_more_than_eight_bytes_do_not_fit_a_frame():
    drive = node()
    steps = [(0x1401, 1, 0x304 | INVALID), (0x1601, 0, 0), (0x1601, 1, 0x607A0020), (0x1601, 2, 0x60FF0020), (0x1601, 3, 0x60400010)]  # fmt: skip
    assert [write(drive, *step) for step in steps] == [0] * 5
    assert write(drive, 0x1601, 0, 3) == ABORT_PDO_LENGTH
    assert write(drive, 0x1601, 0, 2) == 0


@pytest.mark.parametrize("entry", [0x60640020, 0x60650020, 0x607A0010, 0x2FFF0010])
def test_what_cannot_be_received_is_not_mapped(entry):
    """Read only, not mappable, of another length, not there."""
    drive = node()
    assert [write(drive, *step) for step in RIGHT[:2]] == [0, 0]
    assert write(drive, 0x1600, 1, entry) == ABORT_NOT_MAPPABLE


def test_a_node_in_pre_operational_hears_no_process_data():
    drive = node()
    assert [write(drive, *step) for step in RIGHT] == [0] * len(RIGHT)
    drive.outgoing.clear()
    drive.hear(0x204, struct.pack("<Hh", 6, 250))
    drive.hear(0x80, b"")
    assert drive._objects[0x607100].value == 0
    assert not drive.outgoing


def test_a_restart_forgets_everything_and_tells_it():
    drive = node(operational=True)
    drive._objects[0x606500].value = 5
    drive.restart()
    assert not drive.outgoing
    for _ in range(10):
        drive.advance(1e-3)
    assert list(drive.outgoing) == [(0x704, b"\0")]
    assert drive._objects[0x606500].value == 2000
