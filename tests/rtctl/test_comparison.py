"""Two runs beside each other: what differs, how far and where, and what was set differently."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hal.errors import RtctlError
from rtctl import comparison
from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.log.format import CONTROLLER
from rtctl.log.reader import Log
from rtctl.log.writer import LogWriter
from rtctl.record import controller_table


@pytest.fixture(scope="module")
def log(insertion):
    return Log.open(insertion.log)


def written(path, log, rows, **header):
    with LogWriter(path, {CONTROLLER: controller_table(3)}, {**log.header, **header}) as writer:
        writer.write_rows(CONTROLLER, rows)
    return path


def test_by_tick_every_signal_is_told_with_its_place(log):
    one, other = log.controller, log.controller[100:].copy()
    other["force_axial_n"][-2000] += 0.25
    other["pose_reference"][-700, 1] = np.nan
    lines = {line.signal: line for line in comparison.by_tick(one, other)}
    assert [n for n, line in lines.items() if not line.good] == ["force_axial_n", "pose_reference[1]"]
    force = lines["force_axial_n"]
    assert (force.largest, force.where, force.unit) == (pytest.approx(0.25), other["tick"][-2000], "N")
    known = np.count_nonzero(~np.isnan(other["force_axial_n"]))
    assert force.rms == pytest.approx(0.25 / np.sqrt(known))
    assert lines["pose_reference[1]"].unknown == 1
    assert "lateness_ns" not in lines


def test_by_depth_the_bounds_of_the_bench_hold(log):
    rows = log.controller
    late = np.concatenate([rows[:1].repeat(300), rows])
    late["pose_measured"][:, 0] += 0.02
    lines = {line.signal: line for line in comparison.by_depth(rows, late)}
    assert [n for n, line in lines.items() if not line.good] == ["pose_measured x"]
    assert lines["pose_measured x"].rms == pytest.approx(0.02)
    assert 0.0 < lines["pose_measured x"].where < 4.0


def test_runs_without_a_common_tick_are_refused(log):
    later = log.controller.copy()
    later["tick"] += 10**9
    with pytest.raises(RtctlError, match="no tick in common"):
        comparison.by_tick(log.controller, later)


def test_what_was_set_differently_is_told(log):
    table = log.settings_table()
    table["admittance"]["deadband_n"] = 0.05
    other = replace(log, header={**log.header, "settings": json.dumps(table), "kernel_hash": "f" * 16, "seed": "9"})
    assert comparison.set_differently(log, other) == {
        "kernel_hash": (log.header["kernel_hash"], "f" * 16),
        "seed": (log.header["seed"], "9"),
        "settings admittance.deadband_n": (log.settings_table()["admittance"]["deadband_n"], 0.05),
    }
    assert comparison.set_differently(log, log) == {}


def test_the_command_tells_it_as_json_and_draws_it(log, insertion, tmp_path, capsys):
    rows = log.controller.copy()
    rows["force_lateral_n"] += 0.1
    changed = written(tmp_path / "log.mcap", log, rows, seed="8")
    picture = tmp_path / "both.png"
    words = ["log", "compare", str(insertion.log), str(tmp_path), "--json", "--picture", str(picture)]
    assert main(words) == Exit.DATA
    told = json.loads(capsys.readouterr().out)
    assert told["by"] == "depth"
    assert [s["signal"] for s in told["signals"] if not s["good"]] == ["force_lateral"]
    assert told["set_differently"]["seed"] == {"one": log.header["seed"], "other": "8"}
    assert picture.stat().st_size > 10_000
    assert main(["log", "compare", str(changed), str(changed), "--by", "tick"]) == Exit.OK
    assert "0 of" in capsys.readouterr().out
