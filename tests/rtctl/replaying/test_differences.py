"""Where two records differ: the earliest row, and in it the signal nearest to the cause."""

import numpy as np
import pytest

from rtctl.log.hashing import output_fields
from rtctl.record import controller_table
from rtctl.replaying.against import compare
from rtctl.replaying.difference import Difference, first_difference
from rtctl.replaying.fingerprint import fingerprints
from rtctl.replaying.stages import OTHER, along_the_tick, stage_of

TABLE = controller_table(3)


@pytest.fixture
def rows():
    made = np.zeros(50, TABLE.dtype)
    made["tick"] = np.arange(100, 150)
    made["depth_mm"] = 1.0
    return made


def test_the_first_difference_is_in_the_earliest_row(rows):
    assert first_difference(rows, rows.copy()) is None
    other = rows.copy()
    other["tick_ns"] += 1
    other["depth_mm"][20:] = 2.0
    other["pose_measured"][30:] = 5.0
    assert first_difference(rows, other) == Difference(120, "depth_mm", 1.0, 2.0)
    other["pose_measured"][10, 1] = -0.0
    found = first_difference(rows, other)
    assert (found.tick, found.field, found.logged) == (110, "pose_measured", [0.0, 0.0, 0.0])


def test_within_a_tick_the_signal_that_is_computed_first_is_named(rows):
    other = rows.copy()
    for name in ("command_applied_v", "force_axial_n", "condition_active", "pose_desired"):
        other[name][7] = 1
    found = first_difference(rows, other)
    assert found.field == "force_axial_n"
    assert found.others == ("pose_desired", "command_applied_v", "condition_active")


def test_every_output_has_its_stage():
    outputs = output_fields(TABLE.dtype)
    assert [name for name in outputs if stage_of(name) == OTHER] == [], "add it to rtctl/replaying/stages.py"
    assert along_the_tick([*reversed(along_the_tick(outputs)), "of_another_version"])[-1] == "of_another_version"


@pytest.mark.parametrize("dtype", ["f8", "i4", "u1"])
def test_a_fingerprint_changes_with_nearly_every_bit(dtype):
    random = np.random.default_rng(1)
    values = random.integers(0, 256, (400, 3 * np.dtype(dtype).itemsize), "u1").view(dtype)
    for bit in range(8 * values.dtype.itemsize * 3):
        changed = values.copy().view("u1").reshape(400, -1)
        changed[:, bit // 8] ^= np.uint8(1 << bit % 8)
        missed = np.mean(fingerprints(values) == fingerprints(changed.view(dtype)))
        assert missed < 0.03, bit
    assert (fingerprints(values) == fingerprints(values.copy())).all()


def test_the_growth_of_a_difference_is_told(rows):
    other = rows.copy()
    other["depth_mm"][20:] += 0.5 * np.arange(30)
    other["force_axial_n"][33:] = np.nan
    found = compare(rows, other)
    assert (found.tick, found.signal, found.row) == (121, "depth_mm", 21)
    depth, force = found.growth
    assert (depth.stage, depth.first_tick, depth.largest[0], depth.largest[10]) == ("motion", 121, 0.5, 5.5)
    assert depth.largest[100] is None
    assert (force.signal, force.first_tick, force.largest[0]) == ("force_axial_n", 133, 0.0)
