"""The law against the plant, in lockstep, with a stylet that is hooked a millimetre late."""

import numpy as np
import pytest

from rtctl import replay
from rtctl.guidance.impedance.layout import READY
from rtctl.lifecycle import Condition, Task
from rtctl.planner import plan_of
from rtctl.settings import load
from rtctl.simulation import simulate
from studies.impedance_guidance import BASE, MODES, bias_of, insert

SEEDS = range(40_000, 40_003)
LATE = (*BASE, "backend.options.phantom.stylet_late_mm=1.0")


@pytest.fixture(scope="module")
def plan():
    return plan_of(load("planar-sim", BASE))


@pytest.fixture(scope="module")
def outcomes(plan):
    return {mode: [insert([*LATE, *chosen], plan, seed) for seed in SEEDS] for mode, chosen in MODES.items()}


def mean(found, name):
    return float(np.mean([getattr(o, name) for o in found]))


def test_a_late_stylet_is_pulled_further_than_planned(outcomes):
    off = outcomes["off"]
    assert mean(off, "offset_mm") == 0.0
    for mode in ("continuous", "stepwise, 1 mm"):
        guided = outcomes[mode]
        assert not any(o.failed for o in guided)
        assert all(o.offset_mm > 0.3 for o in guided)
        assert all(g.stylet_mm > o.stylet_mm + 0.3 for g, o in zip(guided, off, strict=True))
        assert all(g.stylet_mm <= 15.0 for g in guided)


def test_it_is_pressed_against_the_wall_less(outcomes):
    for mode in ("continuous", "stepwise, 1 mm"):
        assert mean(outcomes[mode], "resistance_n") < mean(outcomes["off"], "resistance_n")


def test_the_apical_contacts_have_next_to_no_say(outcomes):
    """A documented limit: 0.7 mm from the modiolus they are at the flat end of the power law."""
    assert all(o.apical_share < 0.1 for o in outcomes["continuous"])
    assert mean(outcomes["off"], "apical_mm") > 0.5


def run(plan, *settings, seed=40_000):
    return simulate(load("planar-sim", [*LATE, *settings]), seed, plan=plan).recording


@pytest.fixture(scope="module")
def bias():
    return f"impedance.bias_ohm={bias_of(LATE, 40_000)}"


def test_switched_off_it_changes_nothing(plan, bias):
    plain = run(plan, "workflow.depth_mm=6.0")
    ready = run(plan, "workflow.depth_mm=6.0", bias, "impedance.interval_mm=1.0", "impedance.when_blind=pause")
    assert plain.records.tobytes() == ready.records.tobytes()


def test_the_reference_comes_out_only_within_the_drives_speed(plan, bias):
    rows = run(plan, bias, "impedance.guidance=true").records
    loaded = rows[rows["array_loaded"] == 1]
    steps = np.diff(loaded["stylet_reference_mm"])
    assert (steps >= 0.0).all()
    assert steps.max() <= 20.0 * 0.001 + 1e-12
    assert loaded["stylet_reference_mm"].max() <= 15.0
    end = loaded[loaded["task_state"] == Task.INSERTING][-1]
    assert end["impedance_offset_mm"] > 0.3
    wanted = min(end["stylet_desired_mm"] + end["impedance_offset_mm"], 15.0)
    assert end["stylet_reference_mm"] == pytest.approx(wanted, abs=0.02)


def test_stepwise_rests_at_every_interval_until_it_is_ready(plan, bias):
    rows = run(plan, bias, *MODES["stepwise, 1 mm"], "workflow.depth_mm=8.5").records
    ready = rows[(rows["impedance_phase"] == READY) & (rows["task_state"] == Task.HOLDING)]
    assert np.unique(ready["depth_mm"].round(6)).tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 8.5]
    corrections = rows[1:][np.diff(rows["impedance_offset_mm"]) > 0.0]
    assert len(corrections) > 0
    assert (corrections["task_state"] == Task.HOLDING).all()
    for depth in range(4, 9):
        at = rows[rows["depth_mm"].round(6) == depth]["impedance_offset_mm"]
        assert len(np.unique(at)) <= 2, "one correction at a depth"


def test_a_telemetry_that_stops_is_told_and_the_insertion_goes_on_or_pauses(plan, bias):
    guided = bias, "impedance.guidance=true", "backend.options.inject.impedance_silent_after_s=18.0"
    rows = run(plan, *guided).records
    silent = (rows["condition_active"] >> Condition.IMPEDANCE_SILENT & 1).astype(bool)
    assert silent.any(), "the telemetry must stop while the array is inserted"
    assert rows["depth_mm"].max() > 13.0
    paused = run(plan, *guided, "impedance.when_blind=pause").records
    assert (paused["condition_active"] >> Condition.IMPEDANCE_LOST & 1).any()
    assert paused["depth_mm"].max() < 13.0
    first = int(np.flatnonzero(silent)[0])
    assert np.ptp(rows["impedance_offset_mm"][first:][rows["task_state"][first:] == Task.INSERTING]) < 1.0


def test_a_guided_run_is_replayed_to_the_bit(plan, bias, tmp_path):
    settings = load("planar-sim", [*LATE, bias, "impedance.guidance=true", "workflow.depth_mm=9.0"])
    rows = simulate(settings, 40_000, plan=plan, log=tmp_path / "log.mcap").recording.records
    assert rows["impedance_offset_mm"].max() > 0.0
    result = replay.run([tmp_path / "log.mcap"])
    assert result.difference is None
    assert result.ticks == len(rows)
