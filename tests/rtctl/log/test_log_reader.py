import json

import pytest

from hal.signals import TICK, TIME, Signal, Table
from rtctl.log.format import LogError, decode_json, dtype_of, encode_json
from rtctl.log.hashing import check_hashes
from rtctl.log.reader import Log, open_many
from rtctl.log.writer import LogWriter
from rtctl.record import controller_table

HEADER = {"settings": json.dumps({"robot": {"kind": "planar_3rpr"}}), "config_hash": "abc", "seed": "1"}


def write(path, table, rows, header=HEADER, **others):
    with LogWriter(path, {"/controller": table}, header, **others) as writer:
        writer.write_rows("/controller", rows)


@pytest.mark.parametrize("dof", [3, 6])
def test_dtype_comes_back_from_the_message_text(dof):
    table = controller_table(dof)
    assert dtype_of(table.message) == table.dtype


@pytest.mark.parametrize("line", ["geometry_msgs/Pose pose", "float64[] open_ended", "string name", "float64"])
def test_message_that_is_not_flat_is_refused(line):
    with pytest.raises(LogError, match="flat record"):
        dtype_of(f"uint64 time_ns\n{line}\n")


def test_json_survives_and_nan_becomes_null():
    payload = {"text": "µ \u0000 ü", "list": [1, 2.5, None, True], "big": 2**63 - 1}
    assert decode_json(encode_json(payload)) == payload
    assert decode_json(encode_json({"value": float("nan")})) == {"value": None}


def test_log_of_another_version_opens_with_its_own_fields(tmp_path, make_rows):
    old = Table(
        "Controller",
        (TIME, TICK, Signal("gone_mm", "f8", (5,), "mm", "no longer there"), Signal("missed_ticks", "u4", (), "", "")),
    )
    rows = make_rows(old, 40)
    write(tmp_path / "old.mcap", old, rows)
    read = Log.open(tmp_path / "old.mcap").controller
    assert read.dtype.names == ("time_ns", "tick", "gone_mm", "missed_ticks", "reserved")
    assert read.tobytes() == rows.tobytes()
    assert not read.flags.writeable


def test_truth_and_lists(tmp_path, table, small_table, make_rows):
    truth = Table("Truth", small_table.signals)
    with LogWriter(tmp_path / "log.mcap", {"/controller": table, "/truth": truth}, HEADER) as writer:
        for i in range(3):
            writer.write_rows("/controller", make_rows(table, 100, first_tick=100 * i))
            writer.write_rows("/truth", make_rows(truth, 100, first_tick=100 * i, seed=i))
        writer.write_json("/parameters", 1, {"number": 1})
        writer.write_json("/plans", 2, {"number": 2})
        writer.write_json("/notes", 3, "of somebody else")
    log = Log.open(tmp_path / "log.mcap")
    assert log.truth is not None
    assert log.truth[100:200].tobytes() == make_rows(truth, 100, first_tick=100, seed=1).tobytes()
    assert log.parameters == [{"number": 1}]
    assert log.plans == [{"number": 2}]
    assert log.messages["/notes"] == [(3, "of somebody else")]
    assert log.settings_table() == {"robot": {"kind": "planar_3rpr"}}
    write(tmp_path / "bare.mcap", table, make_rows(table, 3), header={})
    bare = Log.open(tmp_path / "bare.mcap")
    assert bare.truth is None
    assert bare.events == []
    with pytest.raises(LogError, match="no settings"):
        bare.settings_table()


def test_missing_ticks_are_those_nobody_declared(tmp_path, table, make_rows):
    rows = make_rows(table, 100, first_tick=1000)
    rows["missed_ticks"][50] = 2
    kept = [i for i in range(100) if i not in (20, 21, 22, 46, 47, 48, 49, 70)]
    rows["missed_ticks"][71] = 1
    write(tmp_path / "log.mcap", table, rows[kept])
    assert Log.open(tmp_path / "log.mcap").missing_ticks() == [(1020, 1022), (1046, 1047)]


def test_restarted_gateway_is_joined(tmp_path, table, make_rows):
    rows = make_rows(table, 4000)
    first = LogWriter(tmp_path / "log.mcap", {"/controller": table}, HEADER)
    first.write_rows("/controller", rows[:1500])
    first.write_json("/events", 1, "one")
    first.flush()  # and then the gateway is gone
    write(tmp_path / "log-2.mcap", table, rows[1300:2500])
    write(tmp_path / "log-3.mcap", table, rows[2600:])
    log = open_many([tmp_path / "log.mcap", tmp_path / "log-2.mcap", tmp_path / "log-3.mcap"])
    first.close()
    assert log.controller["tick"].tolist() == [*range(2500), *range(2600, 4000)]
    assert log.missing_ticks() == [(2500, 2599)]
    assert log.events == ["one"]
    assert not log.complete
    assert len(log.paths) == 3
    assert len(log.hashes) == 1 + 2 + 2
    assert check_hashes(log.controller, log.hashes) == []


def test_logs_of_different_runs_are_not_joined(tmp_path, table, make_rows):
    write(tmp_path / "a.mcap", table, make_rows(table, 3))
    write(tmp_path / "b.mcap", table, make_rows(table, 3), header={**HEADER, "config_hash": "other"})
    with pytest.raises(LogError, match="not of the same run"):
        open_many([tmp_path / "a.mcap", tmp_path / "b.mcap"])
    with pytest.raises(LogError, match="no logs"):
        open_many([])


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"PK\x03\x04 something else entirely" * 20])
def test_what_is_not_a_log_is_refused(tmp_path, content):
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(LogError, match="not a log of rtctl"):
        Log.open(tmp_path / "x.mcap")


def test_missing_file_is_told(tmp_path):
    with pytest.raises(LogError, match="No such file"):
        Log.open(tmp_path / "x.mcap")
