"""The scripted insertion in lockstep: complete, repeatable to the byte, and what a log needs for a replay."""

import dataclasses

import numpy as np
import pytest

from rtctl import replay, workflow
from rtctl.commands import CommandRefused, Verb
from rtctl.lifecycle import Condition, Operating, Task
from rtctl.log.reader import Log
from rtctl.recording import logs_in, open_recording
from rtctl.settings import load
from rtctl.simulation import LockstepOperator, Recorder, simulate


def test_whole_work_flow_runs_in_the_order_of_the_paper(insertion):
    assert insertion.simulation.failure is None
    assert tuple(insertion.steps) == workflow.STEPS
    records = insertion.simulation.recording.records
    accepted = [Verb(v) for v in records["command_verb"][records["command_verb"] > 0]]
    assert accepted == [
        Verb.ENABLE, Verb.HOME, Verb.MOVE_CP, Verb.REGISTER_ENTRY, Verb.MOVE_CP, Verb.LOAD_ARRAY, Verb.UNBIAS,
        Verb.MOVE_CP, Verb.LOAD_PLAN, Verb.APPROACH, Verb.INSERT, Verb.STOP, Verb.DISABLE,
    ]  # fmt: skip
    assert (records["command_verdict"][records["command_verb"] > 0] == 1).all()


def test_insertion_reaches_its_depth_and_ends_without_power(insertion):
    records = insertion.simulation.recording.records
    assert records["depth_mm"].max() == pytest.approx(insertion.settings.workflow.depth_mm, abs=1e-9)
    assert (records["operating_state"] != Operating.FAULT).all()
    assert records["task_state"][-1] == Task.DONE
    assert not records["powered"][-1]


def test_the_array_is_near_the_entry_before_the_approach_and_has_touched_nothing(insertion):
    records, truths = insertion.simulation.recording.paired
    planned = np.flatnonzero(records["command_verb"] == Verb.LOAD_PLAN)[0]
    tip = truths["array_tip_in_base_mm"][planned]
    distance = np.linalg.norm(tip - records["pose_entry"][planned][:2])
    assert 0.3 < distance < 2.5
    assert not truths["contact_force_in_base_n"][: planned + 1].any()


def test_log_holds_the_very_rows_and_replays_to_the_bit(insertion):
    log = Log.open(insertion.log)
    recording = insertion.simulation.recording
    assert log.complete
    assert log.controller.tobytes() == recording.records.tobytes()
    assert log.truth is not None
    assert log.truth.tobytes() == recording.truths.tobytes()
    result = replay.run([insertion.log])
    assert result.identical, result.difference
    assert result.ticks == len(recording.records)


def test_recording_from_the_log_equals_the_one_from_memory(insertion):
    kept, read = insertion.simulation.recording, open_recording([insertion.log])
    assert read.settings == kept.settings
    assert read.events == kept.events
    assert read.plan is not None
    assert read.plan.tobytes() == kept.plan.tobytes()
    assert (read.lost_records, read.complete) == (0, True)


def test_same_seed_gives_the_same_bytes_and_another_seed_another_run(insertion, tmp_path):
    again = simulate(insertion.settings, 3, log=tmp_path / "log.mcap")
    assert (tmp_path / "log.mcap").read_bytes() == insertion.log.read_bytes()
    other = simulate(insertion.settings, 4).recording.records
    wrench = other["wrench_in_sensor"][: len(again.recording.records)]
    assert not np.array_equal(wrench, again.recording.records["wrench_in_sensor"][: len(wrench)], equal_nan=True)


def test_a_jammed_motor_is_a_failure_with_step_cause_and_remedy():
    settings = load("planar-sim", ["backend.options.inject.jam_after_s=4.0"])
    result = simulate(settings, 1)
    assert isinstance(result.failure, workflow.WorkflowError)
    assert result.failure.exit_code == 5
    assert result.failure.step in ("move to the entry", "retract")
    assert "rad from its reference" in str(result.failure)
    assert result.failure.remedy
    assert Condition.FOLLOWING_ERROR in workflow.conditions_of(result.failure.record)
    assert not result.recording.records["powered"][-1]


def test_a_refused_command_says_why(make_rig):
    rig = make_rig()
    operator = LockstepOperator(rig.lockstep, Recorder())
    with pytest.raises(CommandRefused, match=r"move_cp refused: .*; run `rtctl") as caught:
        operator.command(Verb.MOVE_CP, 160.0, 0.0, 0.0)
    assert caught.value.exit_code == 4


def test_logs_of_a_restarted_gateway_are_found_in_order(tmp_path):
    for number in ("", "-2", "-10"):
        (tmp_path / f"log{number}.mcap").touch()
    assert [p.name for p in logs_in(tmp_path)] == ["log.mcap", "log-2.mcap", "log-10.mcap"]


def test_recordings_without_truth_have_no_pairs(insertion):
    assert dataclasses.replace(insertion.simulation.recording, truths=None).paired is None
