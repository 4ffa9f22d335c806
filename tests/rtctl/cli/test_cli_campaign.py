"""``rtctl sim --count``: options that belong together, scatter by default, and what is told meanwhile."""

import csv

import pytest

from rtctl.campaign import Standing
from rtctl.cli import campaign, main
from rtctl.cli.exit_codes import Exit
from rtctl.settings import config_hash, load

SHORT = ["--set", "workflow.depth_mm=1.0", "--set", "workflow.hold_s=0.0"]
SCATTER = "backend.options.trial.scatter"


def test_a_campaign_tells_its_progress_and_where_its_table_is(tmp_path, capsys):
    path = tmp_path / "table.csv"
    assert main(["sim", *SHORT, "--seed", "7", "--count", "2", "--to", str(path)]) == Exit.OK
    captured = capsys.readouterr()
    assert captured.out.startswith(f"2 rows in {path}, 0 of them not completed; 2 new, ")
    assert captured.err.splitlines()[0].strip() == "0/2 insertions, 0 not completed, 0.00 rows/s"
    assert captured.err.splitlines()[-1].strip().startswith("2/2 insertions, 0 not completed")
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert [row["seed"] for row in rows] == ["7", "8"]
    assert {row["config_hash"] for row in rows} == {config_hash(load("planar-sim", [*SHORT[1::2], f"{SCATTER}=true"]))}
    assert main(["sim", *SHORT, "--seed", "7", "--count", "2", "--to", str(path)]) == Exit.OK
    assert "; 0 new, " in capsys.readouterr().out
    assert main(["sim", *SHORT, "--count", "2", "--to", str(path), "--no-scatter"]) == Exit.DATA
    assert "begun with other settings" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "scatter"), [(["--no-scatter"], False), (["--set", f"{SCATTER}=false"], False), (["--scatter"], True), ([], True)]
)  # fmt: skip
def test_a_campaign_scatters_unless_told_otherwise(words, scatter, monkeypatch):
    seen = {}
    monkeypatch.setattr(campaign, "run", lambda settings, *rest: seen.update(settings=settings, rest=rest) or Exit.OK)
    assert main(["sim", *words, "--count", "5", "--jobs", "3", "--seed", "2", "--to", "x.csv"]) == Exit.OK
    assert seen["settings"] == load("planar-sim", [f"{SCATTER}={str(scatter).lower()}"])
    assert [str(part) for part in seen["rest"]] == ["2", "5", "3", "x.csv", "None"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--count", "3"], "--to FILE.csv"),
        (["--count", "3", "--to", "x.parquet"], "as CSV"),
        (["--count", "0", "--to", "x.csv"], "greater than or equal to 1"),
        (["--jobs", "0", "--count", "3", "--to", "x.csv"], "'--jobs': Input should be greater"),
        (["--jobs", "2"], "give --count too"),
        (["--to", "x.csv"], "give --count too"),
        (["--count", "3", "--to", "x.csv", "--log", "x.mcap"], "leave out --count"),
        (["--count", "3", "--to", "x.csv", "--json"], "leave out --count"),
    ],
)
def test_options_that_do_not_go_together_are_refused(words, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["sim", *words]) == Exit.BAD_INPUT
    captured = capsys.readouterr()
    assert told in " ".join(captured.err.split())
    assert captured.out == ""
    assert not [*tmp_path.iterdir()]


def test_pace_counts_what_is_new_and_says_what_is_left(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(campaign.time, "monotonic", lambda: now[0])
    pace = campaign.Pace()
    pace.see(Standing(50, 1000, 3))
    assert pace.reading() == "3 not completed, 0.00 rows/s"
    now[0] = 110.0
    pace.see(Standing(70, 1000, 4))
    assert pace.reading() == "4 not completed, 2.00 rows/s, 7 min 45 s left"
    pace.see(Standing(51, 30_000, 4))
    assert pace.reading().endswith("83 h 11 min left")


def test_on_a_terminal_there_is_a_bar(monkeypatch):
    import io

    from rich.console import Console

    screen = io.StringIO()
    monkeypatch.setattr(campaign, "side", lambda: Console(file=screen, force_terminal=True, width=120))
    with campaign.shown(campaign.Pace()) as report:
        report(Standing(0, 4, 0))
        report(Standing(4, 4, 1))
    assert "4/4" in screen.getvalue()
    assert "1 not completed" in screen.getvalue()
