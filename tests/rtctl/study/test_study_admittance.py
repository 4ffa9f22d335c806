"""The admittance study: the sets are those of Table VI.2, its figures follow from the curves, it is repeatable."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from rtctl.cli import main
from rtctl.study import admittance
from rtctl.study.insertions import COUNTED, LAMBDA, Insertion, Insertions

SETS = {one.name: one for one in admittance.SETS}
DRAWN = {"lateral_mm": 0.1, "friction": 0.17}


def insertion(level_n, rise_n=0.0, lateral_n=0.02, failed="", last=1.0):
    """One whose resistance begins at `level_n` and rises linearly, up to the share `last`."""
    axial = np.where(last >= LAMBDA, level_n + rise_n * LAMBDA, np.nan)
    return Insertion(axial, np.full(LAMBDA.size, lateral_n), 1.0, 1.5, False, False, failed, DRAWN)


def test_the_sets_are_those_of_the_table():
    counts = {name: one.count for name, one in SETS.items()}
    assert counts == {"0": 95, "0b": 8, "1": 5, "2": 5, "3": 5, "4": 5, "5": 5}
    todo = admittance.cases()
    assert sum(len(case.seeds) for case in todo) == 95 + 8 + 2 * 5 + 3 * 3 * 5
    assert [c.name for c in todo][-1] == "set 5, f_reg -0.15 N"


def test_no_seed_is_in_two_sets_and_the_regulated_force_does_not_change_them():
    by_set = {}
    for case in admittance.cases():
        assert by_set.setdefault(case.set.name, case.seeds) == case.seeds
    seeds = [seed for found in by_set.values() for seed in found]
    assert len(seeds) == len(set(seeds))


@pytest.mark.parametrize("name", sorted(SETS))
def test_a_set_differs_from_the_others_by_its_law_and_specimen_alone(name):
    case = next(c for c in admittance.cases() if c.set.name == name)
    law, plain = case.settings(), admittance.cases()[0].settings()
    assert law.admittance.lateral == (case.set.lateral_gain > 0)
    assert law.admittance.stylet == (case.set.stylet_gain > 0)
    if case.set.lateral_gain:
        assert law.admittance.lateral_gain_mm_per_n_s == case.set.lateral_gain
    assert replace(law, admittance=plain.admittance, backend=plain.backend) == plain


def test_figures_of_an_insertion_are_those_of_its_curve():
    found = Insertions([insertion(0.02, rise_n=0.1)])
    assert found.mean_n() == pytest.approx([0.02 + 0.1 * LAMBDA[COUNTED].mean()])
    assert found.peak_n() == pytest.approx([0.02 + 0.1 * LAMBDA[COUNTED].max()])
    assert found.post_aos_n()[0] > found.mean_n()[0]


def test_one_that_ended_early_counts_as_far_as_it_got_and_one_that_never_began_not_at_all():
    found = Insertions([insertion(0.05), insertion(0.03, last=0.2, failed="stopped"), insertion(np.nan, failed="lost")])
    assert found.mean_n() == pytest.approx([0.05, 0.03])
    assert found.post_aos_n() == pytest.approx([0.05])
    assert found.ended_early.tolist() == [False, True, True]


def test_the_table_has_the_one_sided_test_of_the_difference_that_is_there():
    base = Insertions([insertion(f) for f in (0.040, 0.045, 0.050, 0.038)])
    lower = Insertions([insertion(f) for f in (0.030, 0.033, 0.029)])
    todo = [admittance.Case(SETS["0"], np.nan, range(4)), admittance.Case(SETS["1"], np.nan, range(3))]
    text = admittance.table(todo, [base, lower])
    p = stats.ttest_ind(lower.mean_n(), base.mean_n(), equal_var=False, alternative="less").pvalue
    row = next(line for line in text.splitlines() if line.startswith("| set 1 "))
    assert f"| {p:.3f} |" in row
    assert "| 31 (2) |" in row
    assert "| *1, printed* | *5* | *52 (29)* |" in text


def test_the_command_runs_the_sets_and_leaves_table_rows_and_figures(tmp_path, monkeypatch, capsys):
    few = tuple(replace(one, count=2) for one in admittance.SETS if one.name in ("0", "3"))
    monkeypatch.setattr(admittance.cases, "__defaults__", (0, few))
    folder = tmp_path / "study"
    assert main(["study", "admittance", "--to", str(folder), "--jobs", "1"]) == 0
    assert capsys.readouterr().out == (folder / "table.md").read_text() + "\n"
    with (folder / "insertions.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["regulated_force_n"] for row in rows] == ["", "", "-0.05", "-0.05", "-0.1", "-0.1", "-0.15", "-0.15"]
    assert [row["seed"] for row in rows] == ["0", "1", *3 * ["1000", "1001"]]
    assert [row["correction_mm"] == "0.0" for row in rows] == [True, True, *6 * [False]]
    assert {f.name for f in folder.iterdir()} == {
        "table.md", "insertions.csv", "mean-force-phantom.svg", "corrections.svg"
    }  # fmt: skip


def test_a_file_in_the_way_is_refused_before_anything_runs(tmp_path, capsys):
    (tmp_path / "taken").write_text("mine")
    assert main(["study", "admittance", "--to", str(tmp_path / "taken")]) != 0
    assert "--to is not a folder" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "mine"
