"""The script against an operator that answers from a list: what is waited for, and how failures are told."""

import math

import numpy as np
import pytest

from rtctl import robots, workflow
from rtctl.commands import Verb
from rtctl.electrode.array_shape import tip
from rtctl.lifecycle import Condition, Operating, Task
from rtctl.record import controller_table
from rtctl.settings import load
from rtctl.workflow import Cause, Script, WorkflowError

SETTINGS = load("planar-sim")
ROBOT = robots.load(SETTINGS.robot.kind, SETTINGS.robot.geometry)
TABLE = controller_table(3)


def record(tick: int, **fields) -> np.void:
    """A record at rest, enabled, with `fields`."""
    row = np.zeros(1, TABLE.dtype)[0]
    row["tick"], row["time_ns"] = tick, tick * 1_000_000
    row["operating_state"], row["stop_cause"], row["fault_cause"] = Operating.ENABLED, -1, -1
    for name, value in fields.items():
        row[name] = value
    return row


class Scripted:
    """An operator who hears records from a list, then waits in vain."""

    def __init__(self, *records: np.void, tick: int = 10) -> None:
        self.records, self.tick = list(records), tick
        self.commands: list[tuple] = []

    def command(self, verb, *arguments):
        self.commands.append((verb, *arguments))
        return self.tick

    def wait(self, until, _timeout_s):
        last = None
        while self.records:
            last = self.records.pop(0)
            if until(last):
                break
        return last

    def plan(self, progress):
        progress(0.5)
        return self.tick

    def causes(self, row):
        return [Cause(f"cause {c.name}", f"remedy {c.name}") for c in workflow.conditions_of(row)]


def script(operator: Scripted, report=lambda _: None) -> Script:
    return Script(operator, report, ("plan", "approach", "insert"))


def test_records_older_than_the_command_do_not_count():
    stale, fresh = record(9, task_state=Task.AT_ENTRY), record(12, task_state=Task.AT_ENTRY)
    assert script(Scripted(stale, record(11, task_state=Task.APPROACH, is_busy=1), fresh)).approach()["tick"] == 12


def test_a_step_that_never_ends_is_told_with_its_time_limit():
    with pytest.raises(WorkflowError, match=r"approach: not finished after 30 s; look at"):
        script(Scripted(*(record(t, is_busy=1) for t in range(10, 20)))).approach()


def test_no_record_at_all_is_told():
    with pytest.raises(WorkflowError, match="insert: no record arrived"):
        script(Scripted()).insert(5.0, 1.0)


@pytest.mark.parametrize(
    ("state", "code", "words"),
    [(Operating.FAULT, 5, "FAULT"), (Operating.PAUSED, 1, "PAUSED"), (Operating.DISABLED, 1, "DISABLED")],
)
def test_leaving_enabled_ends_the_step_at_once_with_the_causes(state, code, words):
    row = record(12, operating_state=state, condition_active=1 << Condition.FORCE_LIMIT, is_busy=1)
    operator = Scripted(row, record(13))
    with pytest.raises(
        WorkflowError, match=f"the controller is {words}: cause FORCE_LIMIT; remedy FORCE_LIMIT"
    ) as caught:
        script(operator).insert(5.0, 1.0)
    assert (caught.value.exit_code, caught.value.step, caught.value.record["tick"]) == (code, "insert", 12)
    assert [c.text for c in caught.value.causes] == ["cause FORCE_LIMIT"]
    assert operator.records, "nothing is waited for after the end"


def test_a_motion_that_was_stopped_is_not_taken_for_a_finished_one():
    stopped = record(20, task_state=Task.HOLDING, depth_mm=2.0, stop_cause=Condition.WORKSPACE)
    with pytest.raises(WorkflowError, match="the motion was stopped: cause WORKSPACE"):
        script(Scripted(record(11, is_busy=1), stopped)).insert(5.0, 1.0)


def test_an_insertion_is_over_only_at_its_depth():
    short, full = record(20, task_state=Task.HOLDING, depth_mm=4.99), record(30, task_state=Task.HOLDING, depth_mm=5.0)
    assert script(Scripted(short, full)).insert(5.0, 1.0)["tick"] == 30


def test_progress_counts_steps_and_follows_the_depth():
    told = []
    rows = [
        record(10 + k, task_state=Task.INSERTING, is_busy=1, depth_mm=k / 2, force_axial_n=-0.01 * k) for k in range(10)
    ]
    done = record(25, task_state=Task.HOLDING, depth_mm=5.0)
    script(Scripted(*rows, done), told.append).insert(5.0, 1.0)
    fractions = [p.fraction for p in told]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert {(p.index, p.count, p.name) for p in told} == {(2, 3, "insert")}
    assert told[5].force_n == pytest.approx(0.01 * 2 * told[5].depth_mm)
    assert told[-1].time_s == pytest.approx(0.015)


def test_a_move_waits_for_the_setpoint_to_be_there():
    goal = np.array([160.0, 1.0, 0.1])
    operator = Scripted(
        record(12, pose_desired=goal - 0.01), record(13, pose_desired=goal, is_busy=1), record(14, pose_desired=goal)
    )
    steps = Script(operator, lambda _: None, ("retract",))
    steps.record = record(5, pose_measured=[170.0, 0.0, 0.0])
    assert steps.move("retract", goal, SETTINGS)["tick"] == 14
    assert operator.commands == [(Verb.MOVE_CP, 160.0, 1.0, 0.1)]


@pytest.mark.parametrize("phi", [-0.2, 0.0, 0.15])
def test_the_straight_array_ends_one_standoff_before_the_entry(phi):
    entry = np.array([172.0, 3.0, phi])
    pose = workflow.pose_before_entry(SETTINGS, ROBOT, entry)
    x, y = tip(np.array(SETTINGS.electrode.modal_matrix), 0.0)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    tip_in_base = pose[:2] + np.array([c * x - s * y, s * x + c * y])
    along = np.array([math.cos(phi), math.sin(phi)])
    assert pose[2] == phi
    assert tip_in_base == pytest.approx(entry[:2] - workflow.STANDOFF_MM * along, abs=1e-12)


def test_causes_are_those_that_hold_and_those_that_ended_something():
    row = record(
        1, condition_active=1 << Condition.OVERRUN, stop_cause=Condition.OVERRUN, fault_cause=Condition.AXES_LOST
    )
    assert workflow.conditions_of(row) == [Condition.OVERRUN], "an old fault is no cause once it is acknowledged"
    row["operating_state"] = Operating.FAULT
    assert workflow.conditions_of(row) == [Condition.OVERRUN, Condition.AXES_LOST]
