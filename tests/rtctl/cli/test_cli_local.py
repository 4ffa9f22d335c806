"""Commands that need no daemon: settings, simulation, logs."""

import json
import tomllib

import pytest

from rtctl import replay
from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.cli.outcome import exit_code
from rtctl.cli.runs import new_directory
from rtctl.replaying.difference import Difference
from rtctl.settings import from_table, load
from rtctl.summary import summarise

SHORT = ["--set", "workflow.depth_mm=2.0", "--set", "workflow.hold_s=0.0"]


def test_settings_shown_read_back_to_the_same(capsys):
    assert main(["config", "show", "planar-sim", "--set", "loop.priority=70"]) == Exit.OK
    shown = tomllib.loads(capsys.readouterr().out)
    assert from_table(shown) == load("planar-sim", ["loop.priority=70"])


def test_settings_as_json_hide_the_password(capsys):
    assert (
        main(["config", "show", "--json", "--set", "gateway.user=ada", "--set", "gateway.password=secret"]) == Exit.OK
    )
    out = capsys.readouterr().out
    assert json.loads(out)["gateway"]["password"] == "***"
    assert "secret" not in out


def test_check_finds_mistakes_in_the_backends_own_settings_too(tmp_path, capsys):
    file = tmp_path / "mine.toml"
    file.write_text("[robot]\nname = 'mine'\n")
    assert main(["config", "check", str(file)]) == Exit.OK
    assert "is good: robot mine" in capsys.readouterr().out
    file.write_text("[backend.options.sensor]\nweigth_n = 2.0\n")
    assert main(["config", "check", str(file)]) == Exit.BAD_INPUT
    assert "did you mean 'weight_n'?" in capsys.readouterr().err


def test_simulation_prints_the_summary_as_json_and_nothing_else(tmp_path, capsys):
    log, folder = tmp_path / "sim.mcap", tmp_path / "report"
    arguments = ["sim", "--seed", "5", *SHORT, "--json", "--log", str(log), "--report", str(folder)]
    assert main(arguments) == Exit.OK
    captured = capsys.readouterr()
    figures = json.loads(captured.out)
    assert (figures["outcome"], figures["depth_mm"], figures["seed"]) == ("completed", 2.0, 5)
    assert captured.err == ""
    assert json.loads((folder / "summary.json").read_text()) == figures
    assert main(["replay", str(log)]) == Exit.OK
    assert "identical" in capsys.readouterr().out


def test_simulation_that_fails_says_why_and_still_tells_its_figures(capsys):
    assert main(["sim", "--set", "backend.options.inject.jam_after_s=4.0", "--json"]) == Exit.FAULT
    captured = capsys.readouterr()
    assert json.loads(captured.out)["fault_cause"]["name"] == "following_error"
    assert "rad from its reference" in captured.err


def test_progress_without_a_terminal_is_a_line_a_step(capsys):
    assert main(["sim", *SHORT]) == Exit.OK
    captured = capsys.readouterr()
    steps = [line for line in captured.err.splitlines() if "/13 " in line]
    assert len(steps) == 13
    assert "completed" in captured.out


def test_log_info_counts_and_notices_a_cut(insertion, tmp_path, capsys):
    assert main(["log", "info", str(insertion.log), "--json"]) == Exit.OK
    facts = json.loads(capsys.readouterr().out)
    assert facts["rows"] == len(insertion.simulation.recording.records)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(insertion.log.read_bytes()[:-200_000])
    assert main(["log", "info", str(cut)]) == Exit.DATA
    captured = capsys.readouterr()
    assert "cut short" in captured.out
    assert "rtctl log recover" in captured.err


def test_recover_then_plot(insertion, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(insertion.log.read_bytes()[:-200_000])
    assert main(["log", "recover", str(cut)]) == Exit.OK
    assert "rows kept" in capsys.readouterr().out
    whole = tmp_path / "cut-recovered.mcap"
    assert main(["log", "plot", str(whole)]) == Exit.OK
    assert (tmp_path / "cut-recovered-report" / "report.html").exists()
    assert main(["log", "recover", str(cut)]) == Exit.DATA, "the target exists"


def test_replay_that_differs_names_tick_and_signal(insertion, monkeypatch, capsys):
    found = Difference(1234, "command_applied_v", [0.0], [0.1])
    monkeypatch.setattr(replay, "run", lambda _: replay.Replay(10, 1, found, False))
    assert main(["replay", str(insertion.log)]) == Exit.DATA
    err = capsys.readouterr().err
    assert "first in tick 1234, signal command_applied_v" in err
    assert "code has changed" in err


def test_exit_code_of_an_insertion(insertion):
    good = summarise(insertion.simulation.recording)
    assert exit_code(good) is Exit.OK
    assert exit_code({**good, "lost_records": 1}) is Exit.DATA
    assert exit_code({**good, "log_complete": False}) is Exit.DATA
    assert exit_code({**good, "outcome": "incomplete"}) is Exit.FAILED
    assert exit_code({**good, "outcome": "paused"}) is Exit.FAILED
    assert exit_code({**good, "outcome": "fault"}) is Exit.FAULT


def test_run_folders_never_collide(tmp_path):
    first = new_directory(tmp_path)
    first.mkdir()
    second = new_directory(tmp_path)
    assert second != first
    assert not second.exists()


@pytest.mark.parametrize("wrong", ["safety.force_limit_n=99", "workflow.entry_pose_mm_rad=[300, 0, 0]", "nonsense"])
def test_wrong_overrides_are_refused_before_anything_starts(wrong, capsys):
    assert main(["sim", "--set", wrong]) == Exit.BAD_INPUT
    assert main(["run", "planar-sim", "--set", wrong]) == Exit.BAD_INPUT
    assert capsys.readouterr().err.startswith("rtctl: ")
