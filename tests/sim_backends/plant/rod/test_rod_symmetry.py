"""Spec 08 section 3: the plane has no hidden direction, neither left nor right, nor a place of its own."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bare_rod import LENGTH_MM, BareRod

from bench.rod_insertion import Case, insert
from sim_backends.plant.options import Anatomy


def test_a_mirrored_load_makes_the_mirrored_shape():
    shapes = []
    for side in (1.0, -1.0):
        rod = BareRod(48)
        rod.load_n[48] = 5.0 / LENGTH_MM**2 * np.array([-0.5, side])
        rod.record["rest_turn_rad"] = 0.01 * side
        rod.relax()
        shapes.append(rod.nodes_mm * [1.0, side])
    assert abs(shapes[0][-1, 1]) > 2.0
    assert shapes[0] == pytest.approx(shapes[1], abs=1e-9)


def test_the_wrench_turns_with_the_whole_scene():
    """Specimen and gripper turned and moved together: the same force along and across the insertion, the same moment."""
    here = Case(last_mm=10.0)
    anatomy = Anatomy()
    elsewhere = replace(
        anatomy,
        insertion_angle_rad=anatomy.insertion_angle_rad + 0.7,
        entry_in_base_mm=tuple(v + d for v, d in zip(anatomy.entry_in_base_mm, (-30.0, 12.0), strict=True)),
    )
    a, b = insert(here), insert(replace(here, anatomy=elsewhere))
    assert np.abs(a.force_n).max() > 0.02
    # a tip that snaps may do so a tick earlier or later
    for ours, other, size in (
        (a.force_n, b.force_n, 1.0),
        (a.aside_n, b.aside_n, 1.0),
        (a.trace["wrench"][:, 2], b.trace["wrench"][:, 2], 20.0),  # of an arm in mm
    ):
        error = np.abs(ours - other)
        assert np.percentile(error, 99) < 1e-4 * size
        assert error.max() < 3e-3 * size


def test_the_same_insertion_twice_is_the_same_to_the_bit():
    """Nothing of the first is left over: a record that is lifted has forgotten everything."""
    case = Case(last_mm=6.0, early_mm=math.pi / 10)
    assert insert(case).trace.tobytes() == insert(case).trace.tobytes()
