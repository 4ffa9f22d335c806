"""The stylet is pulled and never pushed into an array, and whatever it does, it does at its own speed."""

import numpy as np
import pytest

from rtctl.commands import Reason, Verb
from rtctl.lifecycle import Operating, Task

END_MM, STYLET_MM = 10.0, 6.4


@pytest.fixture(scope="module")
def inserted(make_rig):
    rig = make_rig().at_entry()
    rig.do(Verb.INSERT, END_MM, 2.0)
    rig.until(lambda r: r["task_state"] == Task.HOLDING)
    return rig


def test_it_follows_the_plan_and_rests_at_its_end(inserted):
    stylet = inserted.rows["stylet_reference_mm"]
    assert (np.diff(stylet[inserted.rows["array_loaded"] == 1]) >= 0).all()
    assert stylet[-1] == pytest.approx(STYLET_MM)


def test_it_stays_out_during_a_retraction(inserted):
    rig = inserted.fork()
    rig.do(Verb.RETRACT, 0.0, 2.0)
    rig.until(lambda r: r["task_state"] == Task.DONE)
    assert rig.rows["stylet_reference_mm"] == pytest.approx(np.full(len(rig.rows), STYLET_MM))


def test_the_empty_rod_goes_back_at_its_own_speed_and_only_then_takes_an_array(inserted):
    rig = inserted.fork()
    rig.do(Verb.RETRACT, 0.0, 2.0)
    rig.until(lambda r: r["task_state"] == Task.DONE)
    rig.do(Verb.UNLOAD_ARRAY)
    assert rig.order(Verb.LOAD_ARRAY) is Reason.BUSY
    rig.rest()
    steps = np.diff(rig.rows["stylet_reference_mm"])
    assert steps.min() == pytest.approx(-rig.settings.stylet.speed_mm_per_s * 0.001)
    assert rig.last["stylet_reference_mm"] == 0.0
    assert rig.last["stylet_measured_mm"] == pytest.approx(0.0, abs=0.05)
    assert rig.last["operating_state"] == Operating.ENABLED
    rig.do(Verb.LOAD_ARRAY)


@pytest.mark.parametrize("verb", [Verb.INSERT, Verb.RETRACT])
def test_a_speed_the_path_turns_into_too_fast_a_motion_is_refused_with_the_fastest_possible(make_rig, verb):
    limits = "trajectory.speed_rad_per_s=0.02", "trajectory.depth_speed_mm_per_s=5.0"
    rig = make_rig(*limits).at_entry()  # the gentle path turns by 0.01 rad a mm
    if verb == Verb.RETRACT:
        rig.do(Verb.INSERT, END_MM, 1.0)
        rig.until(lambda r: r["task_state"] == Task.HOLDING)
    goal = END_MM if verb == Verb.INSERT else 0.0
    assert rig.order(verb, goal, 2.1) is Reason.SPEED
    assert rig.last["reason_value"] == 2.1
    assert rig.last["reason_bound"] == pytest.approx(2.0, rel=1e-6)
    rig.do(verb, goal, 1.9)


def test_a_paused_stylet_rests_with_the_depth(make_rig):
    rig = make_rig("admittance.stylet=true").at_entry()
    rig.do(Verb.INSERT, END_MM, 2.0)
    rig.until(lambda r: r["depth_mm"] > 5.0)
    rig.controller.memory["state"]["stylet_extra_mm"] += 3.0  # as if the force law had asked for more
    rig.do(Verb.PAUSE)
    rig.rest()
    held = rig.run(1000)["stylet_reference_mm"]
    assert (held == held[0]).all()
    assert held[0] < rig.last["stylet_desired_mm"] + 3.0
    rig.do(Verb.RESUME)
    assert rig.run(200)["stylet_reference_mm"][-1] > held[0]
