"""The mailbox against a deque; staging slots against what was staged last."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtctl.commands import COMMAND, Verb
from rtctl.exchange.mailbox import MAILBOX_SHAPE, STAGING_SLOTS, fetch, post, stage, staging_shape, take

PLAN = np.dtype([("depth_mm", "f8", (20,)), ("rows", "i8")])
ROOM = MAILBOX_SHAPE[0] - 1


def command(sequence: int) -> np.ndarray:
    row = np.zeros(1, COMMAND)
    row["sequence"], row["verb"], row["argument"] = sequence, Verb.SERVO_CP, sequence + np.arange(8) / 8
    return row


@given(st.lists(st.tuples(st.integers(0, 80), st.integers(0, 80)), max_size=6))
@settings(max_examples=30, deadline=None)
def test_mailbox_is_a_queue_that_refuses_when_full(bursts: list[tuple[int, int]]) -> None:
    mailbox = np.zeros(MAILBOX_SHAPE, np.int64)
    model: deque[int] = deque()
    taken = np.zeros(1, COMMAND)
    sequence = 0
    for posts, takes in bursts:
        for _ in range(posts):
            sequence += 1
            assert post(mailbox, command(sequence)[0]) == (len(model) < ROOM)
            if len(model) < ROOM:
                model.append(sequence)
        for _ in range(takes):
            assert take(mailbox, taken[0]) == bool(model)
            assert taken.tobytes() == (command(model.popleft()) if model else np.zeros(1, COMMAND)).tobytes()


def plan(number: int) -> np.ndarray:
    row = np.zeros(1, PLAN)
    row["depth_mm"], row["rows"] = number + np.arange(20), number
    return row


@given(st.integers(1, 40), st.integers(-2, 45), st.integers(-1, STAGING_SLOTS))
@settings(max_examples=60, deadline=None)
def test_a_slot_gives_only_the_number_it_holds(staged: int, wanted: int, slot: int) -> None:
    slots = np.zeros(staging_shape(PLAN), np.int64)
    places = {n: stage(slots, n, plan(n)[0]) for n in range(1, staged + 1)}
    last_four = range(max(1, staged - STAGING_SLOTS + 1), staged + 1)
    got = plan(0)
    found = fetch(slots, slot, wanted, got[0])
    assert found == (wanted in last_four and places[wanted] == slot)
    if found:
        assert got.tobytes() == plan(wanted).tobytes()
    assert all(fetch(slots, places[n], n, got[0]) for n in last_four)


def test_a_slot_left_half_written_gives_nothing_until_it_is_staged_again() -> None:
    slots = np.zeros(staging_shape(PLAN), np.int64)
    slot = stage(slots, 7, plan(7)[0])
    slots[slot, 0] += 1  # a producer that was killed inside stage
    got = plan(0)
    assert not fetch(slots, slot, 7, got[0])
    stage(slots, 7, plan(7)[0])
    assert fetch(slots, slot, 7, got[0])
    assert got.tobytes() == plan(7).tobytes()


def test_payloads_of_another_length_are_refused() -> None:
    slots = np.zeros(staging_shape(PLAN), np.int64)
    with pytest.raises(ValueError, match="as long as"):
        stage(slots, 1, command(1)[0])
    with pytest.raises(ValueError, match="as long as"):
        fetch(slots, 1, 1, command(1)[0])
