"""The deadman against everything a network, a clock and a device can do to it."""

import json

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtctl.operator.link import FORGET_S, Link, Loss
from rtctl.operator.message import LARGEST_BYTES, Button, MessageError, decode

LIMIT_S = 0.08
UNIX_NS = 1_700_000_000_000_000_000


def message(sequence, **changes):
    fields = {
        "version": 1,
        "source": "pad-1",
        "sequence": sequence,
        "timestamp_ns": UNIX_NS,
        "frame": "base",
        "twist": [1.0, 0, 0, 0, 0, 0],
        "buttons": 0,
        "deadman": True,
    }
    return fields | changes


class Wire:
    """A link, and a sender whose clock and the link's agree."""

    def __init__(self, now_s=100.0):
        self.link, self.now_s, self.sequence = Link(LIMIT_S), now_s, 0

    def send(self, *, after_s=0.01, age_s=0.0, raw=None, **changes):
        self.now_s += after_s
        self.sequence += 1
        arrival_ns = UNIX_NS + round(self.now_s * 1e9)
        fields = message(self.sequence, timestamp_ns=arrival_ns - round(age_s * 1e9)) | changes
        self.link.receive(json.dumps(fields).encode() if raw is None else raw, self.now_s, arrival_ns)
        return self

    def follow(self):
        """Released, then held: it counts."""
        self.send(deadman=False).send()
        assert self.counts()
        self.link.take_losses()
        return self

    def counts(self, after_s=0.0):
        self.now_s += after_s
        return self.link.demand(self.now_s) is not None

    def losses(self):
        return [loss for loss, _ in self.link.take_losses()]


def test_a_deadman_that_was_never_seen_released_does_not_count():
    wire = Wire()
    for _ in range(10):
        assert not wire.send().counts()
    assert wire.send(deadman=False).send().counts()


def test_a_held_fresh_deadman_gives_the_twist_and_says_how_long_it_lasts():
    wire = Wire().follow()
    wire.send(twist=[1, 2, 3, 0.1, 0.2, 0.3], frame="gripper", age_s=0.03)
    demand = wire.link.demand(wire.now_s + 0.02)
    np.testing.assert_array_equal(demand.twist, [1, 2, 3, 0.1, 0.2, 0.3])
    assert demand.frame == "gripper"
    assert demand.left_s == pytest.approx(LIMIT_S - 0.05)
    assert wire.losses() == []


ENDS = {
    "released": ({"deadman": False}, Loss.RELEASED),
    "duplicate": ({"sequence": 2}, Loss.ORDER),
    "overtaken": ({"sequence": 1}, Loss.ORDER),
    "another source": ({"source": "pad-2"}, Loss.SOURCE),
    "late": ({"age_s": LIMIT_S}, Loss.LATE),
    "from the future": ({"age_s": -0.03}, Loss.CLOCK),
    "stop": ({"buttons": 1}, Loss.STOPPED),
    "NaN": ({"raw": json.dumps(message(3, twist=[float("nan")] * 6)).encode()}, Loss.MALFORMED),
    "infinite": ({"raw": json.dumps(message(3, twist=[float("inf")] * 6)).encode()}, Loss.MALFORMED),
    "beyond any double": ({"raw": json.dumps(message(3)).replace("1.0", "1e999").encode()}, Loss.MALFORMED),
    "five numbers": ({"twist": [0] * 5}, Loss.MALFORMED),
    "seven numbers": ({"twist": [0] * 7}, Loss.MALFORMED),
    "huge translation": ({"twist": [100.1, 0, 0, 0, 0, 0]}, Loss.MALFORMED),
    "huge rotation": ({"twist": [0, 0, 0, 0, 0, -10.1]}, Loss.MALFORMED),
    "a button nobody knows": ({"buttons": 64}, Loss.MALFORMED),
    "a negative bit field": ({"buttons": -1}, Loss.MALFORMED),
    "a deadman that is a number": ({"deadman": 1}, Loss.MALFORMED),
    "a deadman that is a word": ({"deadman": "true"}, Loss.MALFORMED),
    "no such frame": ({"frame": "tracker"}, Loss.MALFORMED),
    "a newer version": ({"version": 2}, Loss.MALFORMED),
    "sequence zero": ({"sequence": 0}, Loss.MALFORMED),
    "nobody": ({"source": ""}, Loss.MALFORMED),
    "a name without end": ({"source": "x" * 65}, Loss.MALFORMED),
    "one field more": ({"speed": 1}, Loss.MALFORMED),
    "empty": ({"raw": b""}, Loss.MALFORMED),
    "not text": ({"raw": b"\xff\xfe\x00"}, Loss.MALFORMED),
    "cut off": ({"raw": json.dumps(message(3)).encode()[:-1]}, Loss.MALFORMED),
    "too long": ({"raw": json.dumps(message(3)).encode() + b" " * LARGEST_BYTES}, Loss.MALFORMED),
    "nested": ({"raw": b"[" * 1000}, Loss.MALFORMED),
}


@pytest.mark.parametrize(("changes", "loss"), ENDS.values(), ids=ENDS)
def test_whatever_is_wrong_ends_it_at_once_and_until_the_deadman_was_seen_released(changes, loss):
    wire = Wire().follow()
    wire.send(**changes)
    assert not wire.counts()
    assert wire.losses() == [loss]
    wire.sequence += 10
    for _ in range(5):
        if loss is Loss.RELEASED:
            break
        assert not wire.send().counts(), "the deadman is not latched"
    assert wire.send(deadman=False).send().counts()


@pytest.mark.parametrize("field", list(message(1)))
def test_every_field_is_in_every_message(field):
    fields = message(1)
    assert decode(json.dumps(fields).encode()).deadman
    del fields[field]
    with pytest.raises(MessageError, match=field):
        decode(json.dumps(fields).encode())


def test_silence_ends_it_after_the_age_limit_and_not_before():
    wire = Wire().follow()
    assert wire.counts(after_s=LIMIT_S - 0.001)
    assert not wire.counts(after_s=0.002)
    assert wire.losses() == [Loss.STALE]
    assert not wire.send().counts()
    assert wire.send(deadman=False).send().counts()


def test_the_way_of_a_message_counts_to_its_age():
    wire = Wire().follow().send(age_s=0.05)
    assert wire.counts(after_s=0.025)
    assert not wire.counts(after_s=0.01)


def test_silence_between_two_looks_is_not_overlooked():
    wire = Wire().follow()
    wire.send(after_s=LIMIT_S + 0.001)
    assert not wire.counts()
    assert wire.losses() == [Loss.STALE]


def test_a_deadman_pressed_during_a_silence_must_be_released_first():
    wire = Wire().follow().send(deadman=False)
    assert not wire.send(after_s=0.5).counts()
    assert wire.send(deadman=False).send().counts()


def test_a_late_release_does_not_permit_the_next_press():
    wire = Wire().send(deadman=False, age_s=0.2)
    assert not wire.send().counts()


def test_two_sources_at_once_move_nothing_and_one_that_left_is_replaced():
    wire = Wire().follow()
    for _ in range(20):
        wire.send(deadman=False)
        wire.send(source="pad-2", deadman=False)
        assert not wire.send().counts()
        assert not wire.send(source="pad-2").counts()
    wire.now_s += FORGET_S
    assert not wire.send(source="pad-2").counts()
    assert wire.send(source="pad-2", deadman=False).send(source="pad-2").counts()


def test_a_device_started_again_under_its_old_name_is_followed_after_a_pause():
    wire = Wire().follow()
    wire.sequence = 0
    assert not wire.send(deadman=False, after_s=0.1).send().counts()
    wire.sequence = 0
    wire.send(deadman=False, after_s=FORGET_S + 0.2)
    assert wire.send().counts()


def test_lost_messages_are_no_harm():
    wire = Wire().follow()
    wire.sequence += 1000
    assert wire.send().counts()


def test_a_button_counts_once_when_it_goes_down_and_only_with_the_deadman():
    wire = Wire().follow()
    wire.send(buttons=Button.FASTER | Button.INSERT).send(buttons=Button.INSERT)
    assert wire.link.demand(wire.now_s).pressed == Button.FASTER | Button.INSERT
    assert wire.link.demand(wire.now_s).pressed == Button(0)
    wire.send(deadman=False).send(deadman=False, buttons=Button.FASTER).send(buttons=Button.FASTER)
    assert wire.link.demand(wire.now_s).pressed == Button(0), "it went down while the deadman was released"
    wire.send(buttons=0).send(buttons=Button.FASTER)
    wire.send(deadman=False).send()
    assert wire.link.demand(wire.now_s).pressed == Button(0), "released before anybody acted on it"


def test_what_is_down_in_the_first_message_was_not_pressed_for_us():
    wire = Wire().send(deadman=False, buttons=Button.INSERT).send(buttons=Button.INSERT)
    assert wire.link.demand(wire.now_s).pressed == Button(0)


STOPS = {
    "first message of all": {},
    "without deadman": {"deadman": False},
    "from another source": {"source": "pad-2"},
    "late": {"age_s": 60.0},
    "from the future": {"age_s": -60.0},
    "overtaken": {"sequence": 1},
}


@pytest.mark.parametrize("changes", STOPS.values(), ids=STOPS)
def test_stop_acts_always_and_once_for_a_press(changes):
    wire = Wire()
    if changes:
        wire.follow()
    wire.send(buttons=Button.STOP, **changes)
    assert wire.link.news.is_set()
    assert wire.link.take_stop()
    wire.send(buttons=Button.STOP, **changes)
    assert not wire.link.take_stop(), "it is still the same press"
    wire.send(deadman=False).send(buttons=Button.STOP)
    assert wire.link.take_stop()


def test_the_same_trouble_over_and_over_is_told_once():
    wire = Wire()
    for _ in range(50):
        wire.send(raw=b"noise")
    assert wire.losses() == [Loss.MALFORMED]
    for _ in range(50):
        wire.send(age_s=5.0).send(raw=b"noise").send(age_s=-5.0)
    assert wire.losses() == [Loss.LATE, Loss.CLOCK]
    wire.follow().send(raw=b"noise")
    assert wire.losses() == [Loss.MALFORMED]


soup = st.binary(max_size=1200) | st.builds(
    lambda fields: json.dumps(fields).encode(),
    st.fixed_dictionaries(
        {},
        optional={
            name: st.sampled_from([value, None, "x", -1, 1e300, float("nan"), [], {}, True])
            for name, value in message(7).items()
        },
    ),
)


@given(st.lists(soup, max_size=20))
def test_byte_soup_never_raises_and_never_counts(payloads):
    wire = Wire().follow()
    for payload in payloads:
        wire.send(raw=payload)
        try:
            good = decode(payload)
        except MessageError:
            assert not wire.counts()
        else:
            assert np.isfinite(good.twist).all()


@given(st.binary(max_size=400), st.integers(0, 300), st.integers(0, 20))
def test_a_damaged_message_never_gives_more_than_a_message_can(garbage, at, cut):
    whole = msgspec.json.encode(message(9))
    try:
        survived = decode(whole[:at] + garbage + whole[at + cut :])
    except MessageError:
        return
    assert len(survived.twist) == 6
    assert np.abs(survived.twist[:3]).max() <= 100
    assert np.abs(survived.twist[3:]).max() <= 10
    assert isinstance(survived.deadman, bool)
