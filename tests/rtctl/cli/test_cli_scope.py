"""``rtctl scope`` on a log, and what it says to options that do not fit."""

import numpy as np
import pytest

from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.lifecycle import Operating
from rtctl.log.format import CONTROLLER
from rtctl.log.writer import LogWriter
from rtctl.record import controller_table
from rtctl.scope.files import load


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a run of 2000 ticks, whose force falls to -0.1 N, and which ends in fault."""
    table, folder = controller_table(3), tmp_path_factory.mktemp("run")
    rows = np.zeros(2000, table.dtype)
    rows["tick"] = np.arange(len(rows))
    rows["time_ns"] = 1_000_000 * rows["tick"]
    rows["force_axial_n"] = np.linspace(0.0, -0.1, len(rows))
    rows["operating_state"] = np.where(rows["tick"] < 1900, Operating.ENABLED, Operating.FAULT)
    with LogWriter(folder / "log.mcap", {CONTROLLER: table}, {}) as writer:
        writer.write_rows(CONTROLLER, rows)
    return folder


def scope(run, *words):
    return main(["scope", "force_axial_n", "--log", str(run), *map(str, words)])


def test_an_edge_in_a_log(run, tmp_path, capsys):
    to, plot = tmp_path / "x.mcap", tmp_path / "x.svg"
    words = ["--trigger", "force_axial_n < -0.05", "--edge", "falling", "--pre", 200, "--samples", 500]
    assert scope(run, *words, "--output", to, "--plot", plot) == Exit.OK
    (capture,) = load(to)
    assert capture["force_axial_n"][199] > -0.05 >= capture["force_axial_n"][200]
    assert capture.trigger_tick == capture["tick"][200] == 1000
    told = capsys.readouterr()
    assert "capture 1 of 1: tick 1000, 500 samples from -0.200 to 0.299 s" in told.err
    assert plot.exists()
    assert scope(run, *words, "--output", to) == Exit.BAD_INPUT
    assert "not overwritten" in capsys.readouterr().err


def test_a_fault_whose_capture_the_end_of_the_log_cuts_short(run, capsys):
    assert scope(run, "--fault", "--pre", 50, "--samples", 200) == Exit.OK
    assert "tick 1900, 150 samples from -0.050 to 0.099 s, cut short" in capsys.readouterr().err
    assert scope(run, "--event", "task:inserting") == Exit.FAILED
    assert "0 of 1 captures" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--trigger", "force"], "not a trigger"),
        (["--trigger", "tick < nan"], "not a trigger"),
        (["--trigger", "tick < 1", "--edge", "rising"], "no such edge"),
        (["--edge", "rising"], "an edge of nothing"),
        (["--fault", "--manual"], "one trigger"),
        (["--samples", "10", "--pre", "10"], "less than `samples`"),
        (["--event", "task:flying"], "no such task"),
        (["--output", "x.pdf"], "unknown kind of file"),
    ],
)
def test_what_does_not_fit_is_told(run, words, text, capsys):
    assert scope(run, *words) == Exit.BAD_INPUT
    assert text in capsys.readouterr().err
