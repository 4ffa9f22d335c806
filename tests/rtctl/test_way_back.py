"""The lateral correction on the way back: the one of the way in, whatever it was, without a step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.kernel import kernel
from rtctl import way_back
from rtctl.commands import Verb
from rtctl.lifecycle import Condition, Task
from rtctl.simulation import LockstepOperator, Recorder
from rtctl.workflow import insert_array

FULL_DEPTH_MM = 15.0


@kernel
def go_in(way, depth, offset):
    for k in range(depth.shape[0]):
        way_back.remember(way, depth[k], offset[k])


@kernel
def come_out(way, depth, offset, out):
    for k in range(1, depth.shape[0]):
        way_back.undo(way, depth[k - 1], depth[k], offset)
        out[k] = offset


def there_and_back(corrections_mm, turn_mm, step_mm=0.003):
    """Corrections (n, 3) on the way in to `turn_mm` and (m, 3) out again, with their depths."""
    depth = np.arange(0.0, turn_mm, step_mm)
    knots = np.linspace(0.0, turn_mm, len(corrections_mm) + 1)
    given_mm = np.column_stack(
        (np.zeros(len(corrections_mm) + 1), np.append(0.0, corrections_mm), np.zeros(len(knots)))
    )
    way_in = np.column_stack([np.interp(depth, knots, given_mm[:, i]) for i in range(3)])
    way = np.zeros((way_back.ROWS, 3))
    go_in(way, depth, way_in)
    back = np.append(depth[::-1], 0.0)
    out = np.zeros((len(back), 3))
    out[0] = way_in[-1]
    come_out(way, back, way_in[-1].copy(), out)
    return depth, way_in, back, out


@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=6), st.floats(0.05, 19.0))
def test_it_is_that_of_the_way_in_at_every_depth_and_has_no_step(corrections_mm, turn_mm):
    depth, way_in, back, out = there_and_back(corrections_mm, turn_mm)
    steepest = np.abs(np.diff(way_in, axis=0)).max(initial=0.0) / 0.003
    expected = np.interp(back, depth, way_in[:, 1])
    assert np.abs(out[:, 1] - expected).max() <= way_back.STEP_MM * steepest + 1e-9
    assert np.abs(np.diff(out[:, 1])).max(initial=0.0) <= 2.0 * 0.003 * steepest + 1e-9
    assert out[-1] == pytest.approx(np.zeros(3), abs=1e-12)


def test_standing_still_or_going_on_in_changes_nothing():
    way, offset, out = np.ones((way_back.ROWS, 3)), np.array([0.0, 2.0, 0.0]), np.zeros((3, 3))
    come_out(way, np.array([4.0, 4.0, 4.5]), offset, out)
    assert offset == pytest.approx([0.0, 2.0, 0.0])


def test_an_array_that_gave_way_far_comes_out_the_way_it_went_in(make_rig):
    """At full depth the correction is millimetres: kept up to the entry it would lead a piston onto its stop."""
    rig = make_rig(f"workflow.depth_mm={FULL_DEPTH_MM}", "workflow.hold_s=0.1", anatomy=True)
    insert_array(LockstepOperator(rig.lockstep, Recorder()), rig.settings, rig.robot)
    inserted = len(rig.rows)
    corrected = np.linalg.norm(rig.rows["admittance_offset_mm"], axis=1).max()
    assert corrected > 1.0
    rig.do(Verb.RETRACT, 0.0, 1.0)
    rig.until(lambda r: r["task_state"] == Task.DONE)
    way_in, back = rig.rows[:inserted], rig.rows[inserted:]
    assert not np.any(back["condition_active"] & (1 << Condition.WORKSPACE | 1 << Condition.FOLLOWING_ERROR))
    assert back["admittance_offset_mm"][-1] == pytest.approx(np.zeros(3), abs=1e-9)
    going = way_in[way_in["task_state"] == Task.INSERTING]
    for i in range(2):
        expected = np.interp(back["depth_mm"], going["depth_mm"], going["admittance_offset_mm"][:, i])
        assert np.abs(back["admittance_offset_mm"][:, i] - expected)[back["depth_mm"] < FULL_DEPTH_MM - 0.1].max() < 0.2
