"""Two processes at full speed on the same memory, one of them killed now and then: nothing torn, nothing miscounted."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import exchange_hammer as hammer
import numpy as np
import pytest

from hal.kernel import kernel
from rtctl.commands import COMMAND
from rtctl.exchange.atomics import WORD, load_acquire
from rtctl.exchange.control import Word, get, put
from rtctl.exchange.mailbox import fetch, take
from rtctl.exchange.ring import RingReader, commit, committed
from rtctl.exchange.segment import Segment

ROOT = Path(__file__).resolve().parents[3]
PATIENCE_S = 60.0


@pytest.fixture
def segment() -> Iterator[Segment]:
    made = Segment.create(hammer.LAYOUT)
    yield made
    made.close()


@contextlib.contextmanager
def process(segment: Segment, task: str) -> Iterator[subprocess.Popen[bytes]]:
    """The other process, at work; stopped by the stop word at the end unless it is dead already."""
    put(segment.control, Word.REAL_TIME_STATE, 0)
    put(segment.control, Word.STOP_REQUEST, 0)
    child = subprocess.Popen(
        [sys.executable, hammer.__file__, str(segment.fd), task],
        pass_fds=[segment.fd],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    try:
        wait_for(lambda: get(segment.control, Word.REAL_TIME_STATE) == 2, child)
        yield child
        put(segment.control, Word.STOP_REQUEST, 1)
        if child.returncode is None:
            assert child.wait(PATIENCE_S) == 0
    finally:
        if child.poll() is None:
            child.kill()
            child.wait()


def wait_for(condition: Callable[[], bool], child: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert child.poll() is None, "the other process ended"
        assert time.monotonic() < end, "the other process does nothing"


def words_per(dtype: np.dtype) -> int:
    return dtype.itemsize // WORD.itemsize


def numbers_in(rows: np.ndarray) -> list[int]:
    return [hammer.number_of(words) for words in rows.view(WORD).reshape(len(rows), words_per(rows.dtype))]


def read_checked(ring: np.ndarray, reader: RingReader) -> int:
    """Read once; every record whole, once and in order, and only those lost that the writer has come round to."""
    before, lost_before = reader.position, reader.lost
    numbers = numbers_in(reader.read())
    assert all(a < b for a, b in zip([before - 1, *numbers], [*numbers, reader.position], strict=True))
    assert len(numbers) + reader.lost - lost_before == reader.position - before
    unbroken = sum(n == reader.position - k for k, n in enumerate(reversed(numbers), start=1))
    newest_lost = reader.position - 1 - unbroken
    assert newest_lost < before or newest_lost <= committed(ring) - hammer.CAPACITY
    return len(numbers)


def frozen(child: subprocess.Popen[bytes], times: int) -> Iterator[None]:
    """Stop the other process wherever it is, and let it go on after the caller had a look."""
    for _ in range(times):
        os.kill(child.pid, signal.SIGSTOP)
        os.waitpid(child.pid, os.WUNTRACED)
        yield
        os.kill(child.pid, signal.SIGCONT)
        time.sleep(0.0002)


@pytest.mark.parametrize(("task", "dtype"), [("records", hammer.RECORD), ("truths", hammer.TRUTH)])
def test_every_record_arrives_whole_or_is_counted_as_lost(segment: Segment, task: str, dtype: np.dtype) -> None:
    ring = getattr(segment, task)
    reader = RingReader(ring, dtype, limit=5)
    copied = 0

    def enough() -> bool:
        nonlocal copied
        copied += read_checked(ring, reader)
        return copied >= 20_000 and reader.lost >= 20_000

    with process(segment, task) as child:
        wait_for(enough, child)
    while count := read_checked(ring, reader):
        copied += count
    assert copied + reader.lost == reader.position == committed(ring)


@kernel
def count_torn(ring, rows, rounds, checked):
    """The reader's copy loop without its checks, or with them: how many copies are mixtures of two records."""
    torn = 0
    for _ in range(rounds):
        row = 1 + committed(ring) % (ring.shape[0] - 1)  # the one the writer is at
        before = load_acquire(ring, (row, 0))
        for i in range(rows.shape[1]):
            rows[0, i] = load_acquire(ring, (row, 1 + i))
        after = load_acquire(ring, (row, 0))
        if checked and (before != after or before % 2 == 1):
            continue
        if hammer.number_of(rows[0]) < 0:
            torn += 1
    return torn


def test_the_hammer_tears_records_unless_the_sequence_is_checked(segment: Segment) -> None:
    rows = np.zeros((1, words_per(hammer.RECORD)), WORD)
    checked = 0

    def torn_without_check() -> bool:
        nonlocal checked
        checked += count_torn(segment.records, rows, 10_000, True)
        return count_torn(segment.records, rows, 10_000, False) > 0

    with process(segment, "records") as child:
        wait_for(lambda: committed(segment.records) > 0, child)
        wait_for(torn_without_check, child)
    assert checked == 0


def test_a_writer_that_stands_still_anywhere_spoils_one_record_at_most(segment: Segment) -> None:
    ring = segment.records
    with process(segment, "records") as child:
        wait_for(lambda: committed(ring) > hammer.CAPACITY, child)
        for _ in frozen(child, 200):
            oldest = committed(ring) - hammer.CAPACITY
            reader = RingReader(ring, hammer.RECORD, position=oldest)
            assert numbers_in(reader.read()) == list(range(oldest + reader.lost, oldest + hammer.CAPACITY))
            assert reader.lost <= 1


def test_a_killed_writer_is_replaced_and_the_count_goes_on(segment: Segment) -> None:
    ring = segment.records
    reader = RingReader(ring, hammer.RECORD, limit=5)
    copied = 0

    def moved_on() -> bool:
        nonlocal copied
        copied += read_checked(ring, reader)
        return reader.position > start + 20_000

    for _ in range(2):
        start = reader.position
        with process(segment, "records") as child:
            wait_for(moved_on, child)
            child.kill()
            child.wait()
        put(segment.control, Word.STOP_REQUEST, 1)
    record = np.zeros(1, hammer.RECORD)
    hammer.fill(record.view(WORD), committed(ring))
    commit(ring, record[0])
    while count := read_checked(ring, reader):
        copied += count
    assert copied + reader.lost == reader.position == committed(ring)


def test_a_killed_gateway_is_replaced_where_it_stopped(segment: Segment) -> None:
    record = np.zeros(1, hammer.RECORD)

    def write(count: int) -> None:
        for _ in range(count):
            hammer.fill(record.view(WORD), committed(segment.records))
            commit(segment.records, record[0])

    with process(segment, "follow") as child:
        write(4)
        wait_for(lambda: get(segment.control, Word.RECORD_POSITION) == 4, child)
        child.kill()
        child.wait()
    write(hammer.CAPACITY)
    fresh = RingReader(segment.records, hammer.RECORD, position=get(segment.control, Word.RECORD_POSITION))
    assert numbers_in(fresh.read()) == list(range(4, 12))
    assert fresh.lost == 0


def fetch_all(slots: np.ndarray) -> int:
    """Fetch from every slot; what comes is whole and has the number asked for. How many came."""
    plan = np.zeros(1, hammer.PLAN)
    came = 0
    for slot, number in enumerate(slots[:, 1].tolist()):
        if fetch(slots, slot, number, plan[0]):
            assert hammer.number_of(plan.view(WORD)) == number
            came += 1
    return came


def test_a_fetched_plan_is_whole_and_the_one_that_was_asked_for(segment: Segment) -> None:
    came, asked = 0, 0

    def enough() -> bool:
        nonlocal came, asked
        came += fetch_all(segment.plans)
        asked += len(segment.plans)
        return came >= 500 and asked - came >= 500

    with process(segment, "plans") as child:
        wait_for(enough, child)
        for _ in frozen(child, 200):
            assert fetch_all(segment.plans) >= len(segment.plans) - 1


def test_every_command_arrives_once_and_in_order(segment: Segment) -> None:
    command = np.zeros(1, COMMAND)
    taken = 0

    def enough() -> bool:
        nonlocal taken
        if take(segment.mailbox, command[0]):
            assert hammer.number_of(command.view(WORD)) == taken
            taken += 1
        return taken >= 20_000

    with process(segment, "commands") as child:
        wait_for(enough, child)
