import pytest

from rtctl.log.info import describe
from rtctl.log.reader import Log
from rtctl.log.writer import LogWriter


def test_describe(tmp_path, table, make_rows):
    rows = make_rows(table, 2000)
    rows["missed_ticks"][501] = 1
    header = {"grade": "sim", "config_hash": "c0ffee", "seed": "3", "kernel_hash": "beef"}
    with LogWriter(tmp_path / "log.mcap", {"/controller": table}, header) as writer:
        for i in [*range(500), *range(501, 700), *range(703, 2000)]:
            writer.write_rows("/controller", rows[i : i + 1])
        writer.write_json("/events", 1, {"name": "started"})
        writer.write_json("/events", 2, {"name": "finished", "outcome": "full insertion"})
    told = describe(Log.open(tmp_path / "log.mcap"))
    assert told["rows"] == 1996
    assert told["duration_s"] == pytest.approx(1.999)
    assert told["rate_hz"] == pytest.approx(1995 / 1.999)
    assert (told["first_tick"], told["last_tick"]) == (0, 1999)
    assert told["missed_ticks"] == 1
    assert told["gaps"] == [(700, 702)]
    assert told["lost_ticks"] == 3
    assert [told[k] for k in header] == list(header.values())
    assert told["complete"] is True
    assert told["lost_bytes"] == 0
    assert told["size_bytes"] == (tmp_path / "log.mcap").stat().st_size
    assert told["outcomes"] == [{"name": "finished", "outcome": "full insertion"}]
    assert told["hashed_seconds"] == 2
    assert told["topics"] == {"/controller": 1996, "/events": 2, "/parameters": 0, "/plans": 0, "/hash": 2}


def test_describe_a_log_that_ended_at_once(tmp_path, table):
    LogWriter(tmp_path / "log.mcap", {"/controller": table}, {"seed": "1"}).flush()
    told = describe(Log.open(tmp_path / "log.mcap"))
    assert (told["rows"], told["duration_s"], told["rate_hz"]) == (0, 0.0, 0.0)
    assert told["first_tick"] is None
    assert told["gaps"] == []
    assert told["complete"] is False
