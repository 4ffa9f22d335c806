"""The tracker's words: golden values, an independent CRC, byte soup, poses there and back."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.polaris import protocol
from drivers.polaris.geometry import mean_quaternion, product, relative, rotation, transform
from drivers.polaris.protocol import Pose, Seen

# two tools of one frame, the second hidden, and the tracker's own status
TX = "0201+09659+00000-02588+00000-012345+000067-109999+00123000000310000003C\n02MISSING000000310000003C\n0000"


def crc_by_division(data: bytes) -> int:
    """CRC-16 of reflected bits as the remainder of a division by x^16 + x^15 + x^2 + 1."""
    bits = [byte >> i & 1 for byte in data for i in range(8)] + [0] * 16
    for at in range(len(bits) - 16):
        if bits[at]:
            for power in (16, 15, 2, 0):
                bits[at + 16 - power] ^= 1
    return sum(bit << i for i, bit in enumerate(bits[-16:]))


@pytest.mark.parametrize(("text", "line"), [("INIT:", b"INIT:E3A5\r"), ("OKAY", b"OKAYA896\r"), ("RESET", b"RESETBE6F\r")])  # fmt: skip
def test_golden_lines(text, line):
    assert protocol.frame(text) == line
    assert protocol.unframe(line[:-1]) == text


@given(st.binary(max_size=200))
def test_the_crc_is_the_remainder_of_a_division(data):
    assert protocol.crc16(data) == crc_by_division(data)


@given(st.text(st.characters(codec="ascii"), max_size=100))
def test_what_is_framed_is_unframed(text):
    assert protocol.unframe(protocol.frame(text)[:-1]) == text


@given(st.binary(max_size=100), st.integers(0, 799))
def test_byte_soup_is_no_line_and_no_single_bit_error_gets_through(data, bit):
    text = protocol.unframe(data)
    assert text is None or data[-4:] == b"%04X" % crc_by_division(data[:-4])
    line = bytearray(protocol.frame("TX:0801")[:-1])
    line[bit % (8 * len(line)) // 8] ^= 1 << bit % 8
    assert protocol.unframe(bytes(line)) is None


@given(st.text(max_size=300))
def test_soup_is_no_tool(text):
    assert not protocol.parse_tx(text)


@given(st.integers(0, len(TX) - 1), st.characters(codec="ascii"))
def test_a_changed_character_never_raises_nor_makes_a_rotation_that_is_none(at, character):
    for tool in protocol.parse_tx(TX[:at] + character + TX[at + 1 :]) or []:
        if tool.pose is not None:
            assert math.hypot(*tool.pose.quaternion) == pytest.approx(1.0)
            assert all(map(math.isfinite, (*tool.pose.position_mm, tool.pose.error_mm)))


def test_golden_poses():
    seen, hidden = protocol.parse_tx(TX)
    norm = math.hypot(0.9659, 0.2588)
    assert seen.pose.quaternion == pytest.approx((0.9659 / norm, 0, -0.2588 / norm, 0))
    assert seen.pose.position_mm == (-123.45, 0.67, -1099.99)
    assert seen.pose.error_mm == 0.0123
    assert hidden == Seen(2, 60, 0x31, None)


@pytest.mark.parametrize("text", ["00", TX[:-1], TX + "0", TX.replace("+09659", "+05659"), "", "ERROR0C"])
def test_replies_that_are_none(text):
    found = protocol.parse_tx(text)
    assert found is None or found[0].pose is None


def test_tools_that_are_switched_off_are_left_out():
    assert protocol.parse_tx("0201UNOCCUPIED\n02DISABLED000000010000003C\n0000") == []


angles = st.floats(-math.pi, math.pi)
places = st.tuples(*[st.floats(-1000.0, 1000.0)] * 3)
axes = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: math.hypot(*v) > 0.1)


def pose_of(axis, angle, place):
    n, s = math.hypot(*axis), math.sin(angle / 2)
    return Pose((math.cos(angle / 2), *(s * v / n for v in axis)), place, 0.0)


@given(axes, angles, places, axes, angles, places)
def test_relative_poses_are_those_of_the_matrices(axis, angle, place, axis2, angle2, place2):
    tool, reference = pose_of(axis, angle, place), pose_of(axis2, angle2, place2)
    a, b = (transform(p.quaternion, p.position_mm) for p in (tool, reference))
    found = transform(*relative(tool, reference))
    assert (b @ found).ravel() == pytest.approx(a.ravel(), abs=1e-9)
    q = product(np.array(tool.quaternion), np.array(reference.quaternion))
    assert rotation(q).ravel() == pytest.approx((a[:3, :3] @ b[:3, :3]).ravel(), abs=1e-9)


def test_the_mean_of_rotations_does_not_mind_signs():
    q = np.array([[math.cos(t), 0.0, 0.0, math.sin(t)] for t in (0.1, 0.2, 0.3)])
    q[1] *= -1
    assert mean_quaternion(q) == pytest.approx([math.cos(0.2), 0, 0, math.sin(0.2)], abs=1e-12)
