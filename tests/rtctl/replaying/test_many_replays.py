"""Replays of all runs below a folder: the good, the different and the unreadable, all told."""

import json
import shutil
from pathlib import Path

import pytest

from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.log.format import CONTROLLER
from rtctl.log.reader import Log, LogError
from rtctl.log.writer import LogWriter
from rtctl.replaying.golden import condense, golden_table
from rtctl.replaying.many import name_of, runs_below

GOLDEN = Path(__file__).parents[1] / "golden"


@pytest.fixture
def folder(tmp_path):
    """Two runs that are good, one that was changed, and one that is no log."""
    (tmp_path / "a").mkdir()
    shutil.copy(GOLDEN / "operation.mcap", tmp_path / "a" / "log.mcap")
    shutil.copy(GOLDEN / "guidance.mcap", tmp_path / "7.mcap")
    (tmp_path / "b" / "deep").mkdir(parents=True)
    log = Log.open(GOLDEN / "operation.mcap")
    rows = log.controller.copy()
    at = 500  # homed, and on the move
    rows["axis_angle_rad"][at, 0] += 1e-9
    with LogWriter(tmp_path / "b" / "deep" / "log.mcap", {CONTROLLER: golden_table(3)}, log.header) as writer:
        for topic, messages in log.messages.items():
            if topic != "/hash":
                for m in messages:
                    writer.write_json(topic, m.time_ns, m.payload)
        writer.write_rows(CONTROLLER, rows)
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "log.mcap").write_bytes(b"not a log" * 100)
    return tmp_path, int(rows["tick"][at])


def test_every_run_is_found_and_named(folder):
    found = [name_of(run, folder[0]) for run in runs_below(folder[0])]
    assert found == ["7.mcap", "a", "b/deep", "c"]


def test_the_files_of_a_restarted_gateway_are_one_run(tmp_path):
    for name in ("log.mcap", "log-2.mcap", "log-10.mcap", "other.mcap"):
        (tmp_path / name).touch()
    runs = [[file.name for file in run] for run in runs_below(tmp_path)]
    assert runs == [["log.mcap", "log-2.mcap", "log-10.mcap"], ["other.mcap"]]


def test_what_differs_and_what_cannot_be_read_is_told_and_stops_nothing(folder, capsys):
    directory, tick = folder
    assert main(["replay", "--all", str(directory), "--json", "--jobs", "2"]) == Exit.DATA
    captured = capsys.readouterr()
    told = json.loads(captured.out)
    assert {o["run"]: o["result"] for o in told["outcomes"]} == {
        "7.mcap": "identical", "a": "identical", "b/deep": "different", "c": "unreadable",
    }  # fmt: skip
    different, unreadable = told["outcomes"][2:]
    assert (different["difference"]["tick"], different["difference"]["field"]) == (tick, "pose_measured")
    assert "not a log" in unreadable["error"]
    assert (told["runs"], told["not_identical"]) == (4, 2)
    assert "2 of 4 runs" in captured.err


def test_good_runs_are_a_success(folder, capsys):
    shutil.rmtree(folder[0] / "b")
    shutil.rmtree(folder[0] / "c")
    assert main(["replay", "--all", str(folder[0]), "--jobs", "1"]) == Exit.OK
    assert capsys.readouterr().out.count("identical") == 2


def test_a_folder_without_runs_is_bad_input(tmp_path, capsys):
    with pytest.raises(LogError, match="no log in this folder"):
        runs_below(tmp_path)
    assert main(["replay", "--all", str(tmp_path / "no")]) == Exit.DATA
    assert main(["replay"]) == Exit.BAD_INPUT
    assert main(["replay", "x.mcap", "--against", "a", "--bisect", "b"]) == Exit.BAD_INPUT
    assert "Traceback" not in capsys.readouterr().err


def test_a_run_is_condensed_to_a_golden_log_that_replays(insertion, tmp_path, capsys):
    small = tmp_path / "golden.mcap"
    assert main(["log", "condense", str(insertion.log), "--to", str(small)]) == Exit.OK
    assert small.stat().st_size < insertion.log.stat().st_size / 5
    assert main(["replay", str(small)]) == Exit.OK
    assert f"identical: {len(Log.open(insertion.log).controller)} ticks" in capsys.readouterr().out
    with pytest.raises(LogError, match="there is a log of that name"):
        condense([insertion.log], small)
