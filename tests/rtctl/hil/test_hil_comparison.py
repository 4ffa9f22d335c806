"""What the comparison of two insertions finds, and what it leaves alone."""

import numpy as np
import pytest

from hal.errors import RtctlError
from rtctl.hil.comparison import SIGNALS, compare
from rtctl.hil.insertion import plant_settings
from rtctl.lifecycle import Motion
from rtctl.settings import load


def by_name(found):
    return {d.signal.name: d for d in found}


def test_an_insertion_does_not_differ_from_itself(insertion):
    found = compare(insertion.simulation.recording.records, insertion.simulation.recording.records)
    assert [d.signal for d in found] == list(SIGNALS)
    assert all(d.rms == 0.0 and d.good for d in found)


def test_the_same_insertion_later_does_not_differ(insertion):
    rows = insertion.simulation.recording.records
    late = np.concatenate([rows[:1].repeat(700), rows])
    assert all(d.rms == pytest.approx(0.0, abs=1e-12) for d in compare(rows, late))


@pytest.mark.parametrize(
    ("field", "column", "change", "name"),
    [
        ("pose_measured", 0, lambda x: x + 0.03, "pose_measured x"),
        ("force_axial_n", None, lambda x: -x, "force_axial"),
        ("stylet_measured_mm", None, lambda x: x + 0.02, "stylet_measured"),
        ("command_applied_v", 2, lambda x: -x, "command 3"),
    ],
)
def test_a_wrong_sign_scale_or_offset_is_found_in_its_signal_only(insertion, field, column, change, name):
    rows = insertion.simulation.recording.records
    other = rows.copy()
    values = other[field] if column is None else other[field][:, column]
    values[:] = change(values)
    assert [d.signal.name for d in compare(rows, other) if not d.good] == [name]


def test_unknown_numbers_are_no_agreement(insertion):
    rows = insertion.simulation.recording.records
    other = rows.copy()
    other["force_axial_n"] = np.nan
    assert not by_name(compare(rows, other))["force_axial"].good


def test_without_an_insertion_there_is_nothing_to_compare(insertion):
    rows = insertion.simulation.recording.records
    with pytest.raises(RtctlError, match="no insertion"):
        compare(rows, rows[rows["motion"] != Motion.INSERT])


def test_the_plant_behind_the_bench_is_that_of_planar_sim():
    assert (
        plant_settings(load("planar-hil")).backend.options["anatomy"] == load("planar-sim").backend.options["anatomy"]
    )
    hil, sim = plant_settings(load("planar-hil")), load("planar-sim")
    assert (hil.control, hil.electrode, hil.workflow) == (sim.control, sim.electrode, sim.workflow)
