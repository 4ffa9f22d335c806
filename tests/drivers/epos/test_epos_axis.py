"""Set values and feedback as bytes."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.epos.axis import Axis
from drivers.epos.options import NodeOptions
from drivers.epos.states import STATE_OF, UPWARD, State

ENABLED_WORD = 0x1237
BASE = {
    "node": 3, "axis": 0, "counts_per_rad": 1000.0, "rated_current_a": 0.8, "current_limit_a": 1.6,
    "max_speed_rad_per_s": 100.0, "following_error_rad": 1.0, "quick_stop_rad_per_s2": 1000.0,
}  # fmt: skip


def axis(mode, **more):
    gain = {"gain_a_per_v": 0.1} if mode in ("cst", "current") else {"gain_rad_per_s_per_v": 2.0}
    generation = "epos4" if mode in ("csp", "cst", "ppm") else "epos2"
    return Axis(NodeOptions(**{**BASE, **gain, "mode": mode, "generation": generation, **more}), 2, 1e-3)


def feed(a, word, counts, tick=0):
    a.feed(struct.pack("<Hi", word, counts), tick)


def sent(a, command_v, arm=True, coast=False, reset=False):
    a.demand(command_v, arm, coast, reset)
    return bytes(a.message.data)


@pytest.mark.parametrize(
    ("word", "state"),
    [
        (0x0000, State.NOT_READY), (0x0240, State.DISABLED), (0x0231, State.READY), (0x0233, State.SWITCHED_ON),
        (0x1237, State.ENABLED), (0x0217, State.QUICK_STOP), (0x021F, State.REACTING), (0x0218, State.FAULT),
        (0x4237, State.ENABLED), (0x0260, State.DISABLED), (0x0270, State.DISABLED), (0x0207, State.QUICK_STOP),
        (0x0205, State.UNKNOWN),
    ],
)  # fmt: skip
def test_statuswords(word, state):
    """07 section 2.3; an EPOS2 sets bit 14 beside, and writes quick stop as x001 0111."""
    assert STATE_OF[word & 0x7F] == state


def test_one_step_up_at_a_time_and_none_out_of_a_fault():
    words = {state: UPWARD[state] for state in State}
    assert words == {
        State.NOT_READY: 0x00, State.DISABLED: 0x06, State.READY: 0x07, State.SWITCHED_ON: 0x0F, State.ENABLED: 0x0F,
        State.QUICK_STOP: 0x02, State.REACTING: 0x00, State.FAULT: 0x00, State.UNKNOWN: 0x00,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("mode", "command_v", "data"),
    [
        ("cst", 4.0, "0f00 f401"),  # 0.4 A of 0.8 A rated: 500 per mille
        ("cst", -4.0, "0f00 0cfe"),
        ("cst", 10.0, "0f00 e204"),  # 1.0 A: 1250 per mille
        ("current", 4.0, "0f00 9001"),  # 400 mA
        ("velocity", 5.0, "0f00 5f000000"),  # 10 rad/s = 95 rpm
        ("csp", 5.0, "0f00 7c000000"),  # 104 counts + 10 rad/s in 2 ms = 20 counts
        ("position", -5.0, "0f00 54000000"),
        ("ppm", 5.0, "3f00 7c000000"),
    ],
)
def test_golden_set_values(mode, command_v, data):
    a = axis(mode)
    feed(a, 0x0233, 104)
    sent(a, 0.0)
    feed(a, ENABLED_WORD & ~0x1000 if mode == "ppm" else ENABLED_WORD, 104)
    assert sent(a, command_v) == bytes.fromhex(data)
    assert a.message.arbitration_id == 0x203


def test_a_current_is_never_larger_than_its_limit():
    a = axis("cst", gain_a_per_v=1.0)
    feed(a, ENABLED_WORD, 0)
    assert struct.unpack("<Hh", sent(a, 10.0)) == (0x0F, 2000)
    assert struct.unpack("<Hh", sent(a, -10.0)) == (0x0F, -2000)


@pytest.mark.parametrize("mode", ["cst", "csp", "velocity"])
def test_nothing_is_set_before_the_drive_is_enabled(mode):
    a = axis(mode)
    for word, upward in ((0x0240, 0x06), (0x0231, 0x07), (0x0233, 0x0F)):
        feed(a, word, 77)
        data = sent(a, 10.0)
        assert data[0] == upward
        assert int.from_bytes(data[2:], "little") == (77 if mode == "csp" else 0)


def test_stopping_goes_along_the_ramp_until_its_time_is_over():
    a = axis("cst")
    feed(a, ENABLED_WORD, 0)
    assert sent(a, 5.0, arm=False) == bytes.fromhex("0200 0000")
    assert sent(a, 5.0, arm=False, coast=True) == bytes.fromhex("0000 0000")
    feed(a, 0x0217, 0)
    assert sent(a, 0.0, arm=False) == bytes.fromhex("0200 0000")
    feed(a, 0x0231, 0)
    assert sent(a, 0.0, arm=False) == bytes.fromhex("0000 0000")


def test_a_fault_is_reset_only_when_told_and_never_while_armed():
    a = axis("cst")
    feed(a, 0x0218, 0)
    assert sent(a, 0.0, arm=False)[0] == 0x00
    assert sent(a, 0.0, arm=True, reset=True)[0] == 0x00
    assert sent(a, 0.0, arm=False, reset=True)[0] == 0x80
    assert sent(a, 0.0, arm=False)[0] == 0x00


def test_a_set_position_stops_at_its_limits_and_never_jumps_to_one():
    a = axis("csp", position_limits_rad=(-1.0, 1.0))
    feed(a, 0x0233, 990)
    sent(a, 0.0)
    feed(a, ENABLED_WORD, 990)
    assert [struct.unpack("<Hi", sent(a, 2.0))[1] for _ in range(3)] == [998, 1000, 1000]
    b = axis("csp", position_limits_rad=(-1.0, 1.0))
    feed(b, 0x0233, 5000)
    sent(b, 0.0)
    feed(b, ENABLED_WORD, 5000)
    assert struct.unpack("<Hi", sent(b, 2.0))[1] == 5000
    assert struct.unpack("<Hi", sent(b, -2.0))[1] == 4992


def test_a_new_set_point_of_a_profile_waits_for_the_last_one():
    a = axis("ppm")
    feed(a, ENABLED_WORD & ~0x1000, 0)
    assert sent(a, 5.0)[0] == 0x3F
    feed(a, ENABLED_WORD | 0x1000, 0)
    assert sent(a, 5.0)[0] == 0x2F
    feed(a, ENABLED_WORD & ~0x1000, 0)
    assert sent(a, 5.0)[0] == 0x3F


@given(st.integers(-(2**31), 2**31 - 1), st.lists(st.integers(-190, 190), max_size=40), st.sampled_from([1, -1]))
def test_the_angle_is_the_sum_of_steps_through_any_wrap(start, steps, direction):
    a, counts = axis("cst", direction=direction), start
    feed(a, ENABLED_WORD, counts)
    for tick, step in enumerate(steps):
        counts = (counts + step + 2**31) % 2**32 - 2**31
        feed(a, ENABLED_WORD, counts, 2 * tick)
    assert a.jump_counts == 0
    assert math.isclose(a.angle_rad, direction * sum(steps) / 1000.0, abs_tol=1e-9)


@given(st.floats(-10.0, 10.0), st.sampled_from(["cst", "csp", "ppm", "position", "velocity", "current"]), st.integers(-(2**31), 2**31 - 1), st.integers(0, 0xFFFF))  # fmt: skip
def test_whatever_is_commanded_fits_its_bytes(command_v, mode, counts, word):
    a = axis(mode)
    feed(a, word, counts)
    for _ in range(4):
        assert len(sent(a, command_v)) in (4, 6)


def test_a_step_that_no_motor_makes_is_a_jump():
    """100 rad/s are 100 counts a millisecond; twice that and two counts is the bound."""
    a = axis("cst")
    feed(a, ENABLED_WORD, 0, 0)
    feed(a, ENABLED_WORD, 402, 2)
    assert a.jump_counts == 0
    feed(a, ENABLED_WORD, 402 + 802, 6)
    assert a.jump_counts == 0
    feed(a, ENABLED_WORD, 402 + 802 + 403, 8)
    assert a.jump_counts == 403
