"""Campaigns: a row is its seed's, whoever computed it, and a table goes on from wherever it was ended."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from functools import partial

import pytest

from hal.errors import OptionError, RtctlError
from rtctl import campaign
from rtctl.campaign import row as rows
from rtctl.campaign.table import CampaignError
from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.lockstep import Lockstep
from rtctl.log.reader import Log
from rtctl.planner import plan_of
from rtctl.settings import load
from rtctl.summary import FIGURES

SHORT = ("workflow.depth_mm=1.0", "workflow.hold_s=0.0")
SEEDS = range(20, 25)
ARGUMENTS = ["sim", "--scatter", "--set", SHORT[0], "--set", SHORT[1]]


def read(path):
    return list(csv.DictReader(path.read_text().splitlines()))


@pytest.fixture(scope="module")
def settings():
    return load("planar-sim", [*SHORT, "backend.options.trial.scatter=true"])


@pytest.fixture(scope="module")
def plan(settings):
    return plan_of(settings)


@pytest.fixture(scope="module")
def table(settings, tmp_path_factory):
    """Five insertions, one after the other in this process, and where the campaign was meanwhile."""
    path, told = tmp_path_factory.mktemp("campaign") / "table.csv", []
    end = campaign.run(settings, SEEDS, path, report=told.append)
    assert told == [campaign.Standing(done, 5, 0) for done in range(6)]
    assert end == told[-1]
    return path


def test_rows_are_in_the_order_of_the_seeds_with_all_figures_and_differ(table):
    found = read(table)
    assert [int(row["seed"]) for row in found] == list(SEEDS)
    assert [*found[0]][:9] == [
        "seed", "outcome", "failure",
        "lateral_mm", "out_of_plane_mm", "angle_rad", "stylet_offset_mm", "curvature_error", "friction",
    ]  # fmt: skip
    assert {f.name for f in FIGURES} == ({*found[0]} | {*rows.MEASURED}) - {*[*found[0]][2:9]}
    for name in ("lateral_mm", "insertion_force_mean_n"):
        assert len({row[name] for row in found}) == len(found), name
    assert {row["outcome"] for row in found} == {"completed"}


def test_a_row_tells_what_the_command_tells_for_its_seed(table, capsys):
    assert main([*ARGUMENTS, "--seed", "23", "--json"]) == Exit.OK
    figures = json.loads(capsys.readouterr().out)
    (row,) = (r for r in read(table) if r["seed"] == "23")
    for name, value in figures.items():
        if name not in rows.MEASURED:
            assert row[name] == ("" if value is None else value if isinstance(value, str) else json.dumps(value)), name


def test_the_number_of_processes_does_not_show_in_the_table(settings, table, tmp_path):
    path = tmp_path / "two.csv"
    campaign.run(settings, SEEDS, path, jobs=2)
    assert path.read_bytes() == table.read_bytes()


def test_a_table_cut_in_the_middle_of_a_line_becomes_the_same_table(settings, table, tmp_path, monkeypatch):
    path, run_again = tmp_path / "cut.csv", []
    path.write_bytes(table.read_bytes()[:-40])
    simulate = campaign.row_of
    monkeypatch.setattr(campaign, "row_of", lambda s, seed, **more: run_again.append(seed) or simulate(s, seed, **more))
    campaign.run(settings, SEEDS, path)
    assert run_again == [SEEDS[-1]]
    assert path.read_bytes() == table.read_bytes()
    campaign.run(settings, SEEDS, path)
    assert run_again == [SEEDS[-1]]


def test_insertions_of_a_process_share_one_machine_code(settings):
    """It is never given back: with code of its own a thousand insertions would take gigabytes."""
    assert Lockstep(settings, 0).run is Lockstep(settings, 1).run


def test_other_settings_do_not_go_into_the_table(table, tmp_path):
    path = tmp_path / "table.csv"
    path.write_bytes(table.read_bytes())
    other = load("planar-sim", [*SHORT, "backend.options.trial.scatter=true", "admittance.lateral=false"])
    with pytest.raises(CampaignError, match="begun with other settings"):
        campaign.run(other, SEEDS, path)
    assert path.read_bytes() == table.read_bytes()


def test_wrong_settings_are_an_error_before_there_is_a_table(tmp_path):
    wrong = load("planar-sim", ["backend.options.anatomy.spiral_a_mm=9.0"])
    with pytest.raises(OptionError, match=r"spiral_a_mm is out of bounds: got 9.0 \(allowed: 3.2 .. 4.6 mm\)"):
        campaign.run(wrong, SEEDS, tmp_path / "table.csv")
    assert not [*tmp_path.iterdir()]


def test_an_insertion_that_fails_is_a_row_with_the_reason(plan):
    jammed = load("planar-sim", [*SHORT, "backend.options.inject.jam_after_s=4.0"])
    row = rows.row_of(jammed, 3, plan)
    assert row["outcome"] == "fault"
    assert row["fault_cause"] == "following_error"
    assert "rad from its reference" in row["failure"]
    assert "\n" not in row["failure"]
    assert rows.is_failure(row)


def test_an_insertion_that_cannot_be_set_up_is_a_row_too(settings, monkeypatch):
    def simulate(*_, **__):
        raise RtctlError("the bench cannot\nbe assembled", remedy="bend it")

    monkeypatch.setattr(rows, "simulate", simulate)
    row = rows.row_of(settings, 3)
    assert (row["seed"], row["outcome"]) == ("3", rows.NOT_RUN)
    assert row["failure"] == "the bench cannot be assembled; bend it"
    assert row["config_hash"]
    assert row["kernel_hash"]


def test_logs_are_kept_where_they_are_asked_for(settings, table, tmp_path):
    """One that was cut off with its row is written again, and the row is what it is without."""
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "20.mcap").write_bytes(b"cut off")
    campaign.run(settings, SEEDS[:2], tmp_path / "table.csv", logs=logs)
    assert sorted(p.name for p in logs.iterdir()) == ["20.mcap", "21.mcap"]
    assert Log.open(logs / "20.mcap").complete
    assert read(tmp_path / "table.csv") == read(table)[:2]


def test_failures_are_counted_when_a_table_goes_on(settings, tmp_path, monkeypatch):
    def row_of(settings, seed, plan=None, logs=None):
        bad = {"outcome": "incomplete"} if seed % 2 else {"outcome": "completed"}
        return rows.row_of(settings, SEEDS[0], plan, logs) | {"seed": str(seed)} | bad

    monkeypatch.setattr(campaign, "row_of", row_of)
    path = tmp_path / "table.csv"
    assert campaign.run(settings, range(2), path) == campaign.Standing(2, 2, 1)
    assert campaign.run(settings, range(1, 4), path) == campaign.Standing(3, 3, 2)
    assert [row["seed"] for row in read(path)] == ["0", "1", "2", "3"]


def _rows_in(path):
    return path.read_bytes().count(b"\n") - 1 if path.exists() else 0


@pytest.mark.parametrize(("jobs", "killer"), [(2, signal.SIGINT), (2, signal.SIGKILL)])
def test_an_end_in_the_middle_leaves_a_table_and_no_processes(tmp_path, jobs, killer):
    path = tmp_path / "table.csv"
    command = [sys.executable, "-m", "rtctl", *ARGUMENTS, "--count", "5000", "--to", str(path), "--jobs", str(jobs)]
    listen = partial(signal.signal, signal.SIGINT, signal.default_int_handler)  # a job in the background would not
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, start_new_session=True, preexec_fn=listen
    ) as process:
        end = time.monotonic() + 120
        while _rows_in(path) < 3:
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.1)
        if killer == signal.SIGINT:
            os.killpg(process.pid, signal.SIGINT)  # a terminal tells the whole group
        else:
            process.kill()
        err = process.stderr.read()  # ends when the last process that could write there has ended
    known = _rows_in(path)
    assert known >= 3
    assert path.read_bytes().endswith(b"\n")
    assert "Traceback" not in err
    if killer == signal.SIGINT:
        assert process.returncode == Exit.INTERRUPTED
        assert f"{known} of 5000 rows are in {path}; the same command goes on from there" in err
