"""Captures in files, in pictures, and out of logs."""

import csv

import numpy as np
import pytest

from rtctl.log.format import CONTROLLER, TRUTH, LogError
from rtctl.log.writer import LogWriter
from rtctl.record import controller_table
from rtctl.scope import files
from rtctl.scope.offline import captures_of
from rtctl.scope.pairing import Pairing
from rtctl.scope.probe import Rows
from rtctl.scope.scope import Scope
from rtctl.scope.setup import Level, ScopeError, make_setup
from sim_backends.plant.state import TABLE as TRUTH_TABLE

TABLES = {CONTROLLER: controller_table(3), TRUTH: TRUTH_TABLE}
SIGNALS = ["force_axial_n", "wrench_in_base[2]", "pose_measured", "truth.array_depth_mm", "operating_state"]


def streams(ticks) -> Rows:
    rows = Rows(np.zeros(len(ticks), TABLES[CONTROLLER].dtype), np.zeros(len(ticks), TRUTH_TABLE.dtype))
    for part in rows:
        part["tick"], part["time_ns"] = ticks, 1_000_000 * np.asarray(ticks)
    rows.records["force_axial_n"] = np.sin(np.asarray(ticks) / 10.0)
    rows.records["wrench_in_base"][:, 2] = ticks
    rows.records["pose_measured"] = np.asarray(ticks)[:, None] + [0.1, 0.2, np.nan]
    rows.truths["array_depth_mm"] = -np.asarray(ticks)
    return rows


@pytest.fixture
def captures():
    setup = make_setup(signals=SIGNALS, trigger=Level("force_axial_n", ">", 0.9), samples=20, pre=5, captures=3)
    scope = Scope(setup, TABLES)
    scope.feed(streams([t for t in range(300) if t != 20]))
    return list(scope.finished)


def test_an_mcap_comes_back_as_it_was(captures, tmp_path):
    files.save(captures, tmp_path / "x.mcap")
    again = files.load(tmp_path / "x.mcap")
    assert [c.facts() for c in again] == [c.facts() for c in captures]
    for before, after in zip(captures, again, strict=True):
        assert after.rows.dtype == before.rows.dtype
        assert after.rows.tobytes() == before.rows.tobytes()
        assert after.signals == before.signals
    assert sum(c.lost_records for c in again) == 1
    with pytest.raises(ScopeError, match="not overwritten"):
        captures[0].save(tmp_path / "x.mcap")


def test_other_readers_find_the_names_of_a_message(captures, tmp_path):
    from rosbags.highlevel import AnyReader

    files.save(captures, tmp_path / "x.mcap")
    with AnyReader([tmp_path / "x.mcap"]) as bag:
        topic = [c for c in bag.connections if c.topic == files.TOPIC]
        read = [bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages(connections=topic)]
    assert [m.wrench_in_base_2 for m in read] == [t for c in captures for t in c["tick"]]
    assert [m.capture for m in read] == [0] * 20 + [1] * 20 + [2] * 20


def test_csv_and_npy_hold_every_sample(captures, tmp_path):
    files.save(captures, tmp_path / "x.csv")
    with (tmp_path / "x.csv").open() as text:
        lines = list(csv.DictReader(text))
    files.save(captures, tmp_path / "x.npy")
    array = np.load(tmp_path / "x.npy")
    assert [int(line["tick"]) for line in lines] == array["tick"].tolist() == [t for c in captures for t in c["tick"]]
    assert [float(line["pose_measured_1"]) for line in lines] == array["pose_measured"][:, 1].tolist()
    assert float(lines[5]["time_s"]) == 0.0
    assert float(lines[0]["time_s"]) == -0.005


def test_what_cannot_be_written_or_read_is_told(captures, tmp_path):
    with pytest.raises(ScopeError, match="unknown kind"):
        captures[0].save(tmp_path / "x.xlsx")
    with pytest.raises(LogError, match="cannot write"):
        captures[0].save(tmp_path / "nowhere" / "x.csv")
    with LogWriter(tmp_path / "log.mcap", {CONTROLLER: TABLES[CONTROLLER]}, {}):
        pass
    with pytest.raises(LogError, match="no captures"):
        files.load(tmp_path / "log.mcap")


@pytest.mark.parametrize("ending", [".svg", ".png"])
def test_a_picture_shows_every_signal(captures, tmp_path, ending):
    from rtctl.scope.picture import draw

    draw(captures, tmp_path / f"x{ending}")
    assert (tmp_path / f"x{ending}").stat().st_size > 5000


def test_streams_that_are_read_in_turn_are_joined_by_tick_and_what_one_of_them_lost_is_lost():
    rng = np.random.default_rng(3)
    whole = streams(np.arange(200))
    here, there = rng.random(200) > 0.1, rng.random(200) > 0.1
    records, truths = whole.records[here], whole.truths[there]
    pairing, got = Pairing(), []
    while len(records) or len(truths):
        i, j = rng.integers(0, 20, 2)
        got.append(pairing.pair(records[:i], truths[:j]))
        records, truths = records[i:], truths[j:]
    expected = np.flatnonzero(here & there)
    assert np.concatenate([p.records["tick"] for p in got if len(p.records)]).tolist() == expected.tolist()
    assert np.concatenate([p.truths["array_depth_mm"] for p in got if len(p.records)]).tolist() == (-expected).tolist()


def test_a_stream_that_ended_does_not_make_the_other_one_pile_up(monkeypatch):
    monkeypatch.setattr("rtctl.scope.pairing.LONGEST", 50)
    pairing = Pairing()
    for k in range(100):
        pairing.pair(streams(np.arange(10 * k, 10 * k + 10)).records, np.zeros(0))
    assert len(pairing._records) == 50


def test_a_log_is_searched_like_a_running_controller(tmp_path):
    whole = streams(np.arange(10_000))
    with LogWriter(tmp_path / "log.mcap", TABLES, {"settings": "{}"}) as writer:
        writer.write_rows(CONTROLLER, whole.records)
        writer.write_rows(TRUTH, whole.truths[whole.truths["tick"] != 4])
    from rtctl.log.reader import Log

    log = Log.open(tmp_path / "log.mcap")
    setup = make_setup(signals=SIGNALS, trigger=Level("tick", ">", 9_900.0), samples=200, pre=10)
    (capture,) = captures_of(log, setup)
    assert not capture.complete
    assert capture["tick"].tolist() == list(range(9891, 10_000))
    assert capture["truth.array_depth_mm"].tolist() == [-t for t in range(9891, 10_000)]
    assert capture.units["force_axial_n"] == "N"
    first = next(captures_of(log, make_setup(signals=SIGNALS, samples=8)))
    assert first["lost"].tolist() == [0, 0, 0, 0, 1, 0, 0, 0]
