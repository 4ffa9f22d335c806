"""The ring against a plain Python model, over arbitrary interleavings of its writer and a reader."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtctl.exchange.ring import RingReader, commit, committed, copy_records, ring_shape
from rtctl.record import controller_table

RECORD = controller_table(3).dtype
TRUTH = np.dtype([("time_ns", "u8"), ("tip_mm", "f8", (3,)), ("folded", "u1"), ("reserved", "u1", (7,))])

steps = st.lists(st.one_of(st.just("commit"), st.just("die"), st.integers(1, 4)), max_size=60)


@pytest.mark.parametrize("dtype", [RECORD, TRUTH])
@given(capacity=st.integers(1, 5), steps=steps)
@settings(max_examples=60, deadline=None)
def test_ring_is_a_bounded_queue_that_counts_what_it_drops(dtype: np.dtype, capacity: int, steps: list) -> None:
    ring = np.zeros(ring_shape(dtype, capacity), np.int64)
    record = np.zeros(1, dtype)
    readers = {limit: RingReader(ring, dtype, limit=limit) for limit in range(1, 5)}
    model: deque[int | None] = deque(maxlen=capacity)  # record numbers; None where a dead writer left a half record
    position = dict.fromkeys(readers, 0)
    lost = dict.fromkeys(readers, 0)
    head = 0
    for step in steps:
        if step == "commit":
            record["time_ns"] = head
            commit(ring, record[0])
            model.append(head)
            head += 1
        elif step == "die":  # a writer that was killed inside commit
            row = ring[1 + head % capacity]
            row[:2] = 2 * head + 1, -1
            if len(model) == capacity:
                model[0] = None
        else:
            oldest = head - len(model)
            lost[step] += max(0, oldest - position[step])
            position[step] = max(position[step], oldest)
            expected: list[int] = []
            while position[step] < head and len(expected) < step:
                number = model[position[step] - oldest]
                if number is None:
                    lost[step] += 1
                else:
                    expected.append(number)
                position[step] += 1
            assert readers[step].read()["time_ns"].tolist() == expected
            assert (readers[step].position, readers[step].lost) == (position[step], lost[step])
    assert committed(ring) == head


@given(st.data())
@settings(max_examples=20, deadline=None)
def test_a_record_comes_out_byte_for_byte(data: st.DataObject) -> None:
    payload = data.draw(st.binary(min_size=RECORD.itemsize, max_size=RECORD.itemsize))
    ring = np.zeros(ring_shape(RECORD, 2), np.int64)
    commit(ring, np.frombuffer(payload, RECORD).copy()[0])
    assert RingReader(ring, RECORD).read().tobytes() == payload


def test_a_reader_goes_on_from_the_position_of_another() -> None:
    ring = np.zeros(ring_shape(TRUTH, 8), np.int64)
    record = np.zeros(1, TRUTH)
    for number in range(7):
        record["time_ns"] = number
        commit(ring, record[0])
    first = RingReader(ring, TRUTH, limit=3)
    first.read()
    second = RingReader(ring, TRUTH, position=first.position)
    assert second.read()["time_ns"].tolist() == [3, 4, 5, 6]
    assert second.lost == 0


def test_rows_of_another_length_are_refused() -> None:
    ring = np.zeros(ring_shape(RECORD, 4), np.int64)
    with pytest.raises(ValueError, match="as long as"):
        commit(ring, np.zeros(1, TRUTH)[0])
    with pytest.raises(ValueError, match="as long as"):
        copy_records(ring, 0, np.zeros((4, 5), np.int64))
