"""The segment: both sides mean the same bytes, or say so; nothing outlives the processes."""

import dataclasses
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rtctl.exchange.control import Word, get, put
from rtctl.exchange.ring import RingReader, commit
from rtctl.exchange.segment import Layout, LayoutError, Segment
from rtctl.record import controller_table

ROOT = Path(__file__).resolve().parents[3]
PLAN = np.dtype([("depth_mm", "f8", (20,)), ("rows", "i8")])
PARAMETERS = np.dtype([("gain", "f8", (6,)), ("enabled", "i4"), ("mode", "i4")], align=True)
TRUTH = np.dtype([("time_ns", "u8"), ("tip_mm", "f8", (3,))])
LAYOUT = Layout(controller_table(3).dtype, TRUTH, PLAN, PARAMETERS, capacity=16)


@pytest.fixture
def segment() -> Iterator[Segment]:
    made = Segment.create(LAYOUT)
    yield made
    made.close()


def test_both_sides_see_the_same_arrays_and_no_array_touches_another(segment: Segment) -> None:
    other = Segment.attach(os.dup(segment.fd), LAYOUT)
    names = ("control", "records", "truths", "mailbox", "plans", "parameters")
    for value, name in enumerate(names, start=1):
        getattr(segment, name)[:] = value
    assert [np.unique(getattr(other, name)).tolist() for name in names] == [[v] for v in range(1, 7)]
    assert all(getattr(other, name).ctypes.data % 64 == 0 for name in names)
    other.close()
    assert get(segment.control, Word.TICK) == 1


def test_without_a_simulation_there_is_no_truth() -> None:
    segment = Segment.create(dataclasses.replace(LAYOUT, truth=None))
    assert segment.truths is None
    segment.close()


@pytest.mark.parametrize(
    "change",
    [
        {"record": controller_table(6).dtype},
        {"truth": None},
        {"truth": np.dtype([("time_ns", "u8"), ("tip_m", "f8", (3,))])},
        {"plan": np.dtype([("rows", "i8"), ("depth_mm", "f8", (20,))])},
        {"parameters": np.dtype([("gain", "f8", (6,)), ("mode", "i4"), ("enabled", "i4")], align=True)},
        {"capacity": 17},
    ],
    ids=["record", "no truth", "other name", "other order", "swapped fields", "capacity"],
)
def test_another_layout_is_refused(segment: Segment, change: dict) -> None:
    with pytest.raises(LayoutError, match=r"made for another layout.*same version and the same settings"):
        Segment.attach(segment.fd, dataclasses.replace(LAYOUT, **change))


def test_an_equal_layout_built_anew_is_accepted(segment: Segment) -> None:
    again = Layout(controller_table(3).dtype, np.dtype(TRUTH.descr), np.dtype(PLAN.descr), PARAMETERS, capacity=16)
    Segment.attach(os.dup(segment.fd), again).close()


def test_a_file_that_is_no_segment_is_refused(tmp_path: Path) -> None:
    for content in (b"", b"x" * 4096):
        file = tmp_path / "other"
        file.write_bytes(content)
        with file.open("rb") as f, pytest.raises(LayoutError, match="not a segment"):
            Segment.attach(f.fileno(), LAYOUT)


@pytest.mark.parametrize(
    "change", [{"plan": np.dtype([("a", "f8"), ("b", "u1")])}, {"parameters": np.dtype([])}, {"capacity": 0}]
)
def test_a_layout_that_cannot_work_is_refused(change: dict) -> None:
    with pytest.raises(LayoutError, match="allowed: "):
        dataclasses.replace(LAYOUT, **change)


def test_nobody_can_pull_the_memory_away_from_under_the_others(segment: Segment) -> None:
    for size in (0, 1 << 30):
        with pytest.raises(PermissionError):
            os.ftruncate(segment.fd, size)


def test_close_keeps_arrays_valid_that_are_still_held() -> None:
    segment = Segment.create(LAYOUT)
    records = segment.records
    segment.close()
    segment.close()
    row = np.zeros(1, LAYOUT.record)
    row["time_ns"] = 5
    commit(records, row[0])
    assert RingReader(records, LAYOUT.record).read()["time_ns"].tolist() == [5]


OWNER = """
import sys
import numpy as np
from rtctl.exchange.segment import Layout, Segment
row = np.dtype([("time_ns", "u8")])
segment = Segment.create(Layout(row, None, row, row))
print("ready", flush=True)
sys.stdin.read()
"""

READER = """
import sys
sys.path.insert(0, sys.argv[2])
from test_exchange_segment import LAYOUT
from rtctl.exchange.control import Word, put
from rtctl.exchange.segment import Segment
put(Segment.attach(int(sys.argv[1]), LAYOUT).control, Word.GATEWAY_HEARTBEAT, 77)
"""


def test_nothing_is_left_after_kill_9_of_the_owner() -> None:
    owner = subprocess.Popen(
        [sys.executable, "-c", OWNER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    with owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == b"ready\n"
        maps = Path(f"/proc/{owner.pid}/maps").read_text()
        assert "memfd:rtctl (deleted)" in maps  # the memory is there, and has no name
        assert not list(Path("/dev/shm").glob("*rtctl*"))
        owner.kill()
    assert owner.returncode == -9
    assert not list(Path("/dev/shm").glob("*rtctl*"))


def test_a_reader_that_ends_leaves_the_memory_to_the_others(segment: Segment) -> None:
    subprocess.run(
        [sys.executable, "-c", READER, str(segment.fd), str(Path(__file__).parent)],
        pass_fds=[segment.fd],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        check=True,
        timeout=60,
    )
    assert get(segment.control, Word.GATEWAY_HEARTBEAT) == 77
    put(segment.control, Word.STOP_REQUEST, 1)
    other = Segment.attach(os.dup(segment.fd), LAYOUT)
    assert get(other.control, Word.STOP_REQUEST) == 1
    other.close()
