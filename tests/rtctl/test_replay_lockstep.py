"""A log of a lockstep run is the experiment again, to the bit; one changed input is found and named."""

import numpy as np
import pytest

from hal.errors import RtctlError
from rtctl import replay
from rtctl.commands import Reason, Verb
from rtctl.exchange.control import Grade
from rtctl.gateway.journal import with_bytes
from rtctl.gateway.setup import header_of
from rtctl.lifecycle import Task
from rtctl.log.format import CONTROLLER, PARAMETERS, PLANS
from rtctl.log.writer import LogWriter
from rtctl.record import controller_table


@pytest.fixture(scope="module")
def run(make_rig):
    """Rows of a run with everything in it: moves, streams, an insertion, refusals, a plan and a parameter set."""
    rig = make_rig(seed=7).at_entry()
    memory = rig.controller.memory
    documents = [(PLANS, memory["plan"].copy())]
    rig.do(Verb.INSERT, 5.0, 2.0)
    rig.run(1200)
    memory["staged_parameters"] = memory["parameters"]
    memory["staged_parameters"]["number"], memory["staged_parameters"]["integral"] = 2, 7.5
    documents.append((PARAMETERS, memory["staged_parameters"].copy()))
    rig.do(Verb.SET_PARAMETERS, 2.0)
    rig.run(300)
    rig.do(Verb.PAUSE)
    rig.run(200)
    rig.do(Verb.RESUME)
    rig.until(lambda r: r["task_state"] == Task.HOLDING)
    rig.do(Verb.RETRACT, 0.0, 2.0)
    rig.until(lambda r: r["task_state"] == Task.DONE)
    for verb, *arguments in (
        (Verb.MOVE_CP, 500.0, 0.0, 0.0), (Verb.MOVE_CP, float("nan")), (Verb.LOAD_PLAN, float("nan")),
        (Verb.LOAD_PLAN, 9.0), (Verb.SET_PARAMETERS, 3.0), (Verb.INSERT, 1.0, 99.0), (Verb.RESUME,),
    ):  # fmt: skip
        assert rig.order(verb, *arguments) is not Reason.ACCEPTED
    for _ in range(20):
        rig.do(Verb.SERVO_CV, 2.0, -1.0, 0.01)
        rig.run(9)
    rig.rest()
    rig.move(158.0, -3.0, 0.02)
    rig.lockstep.tick += 100
    rig.run(20)
    rig.do(Verb.ACKNOWLEDGE)
    rig.run(500)
    rows = rig.rows
    missed = np.diff(rows["tick"], prepend=-1) - 1
    rows["missed_ticks"] = missed
    return rig.settings, rig.robot, rows[: np.flatnonzero(missed)[0]], documents


def write(path, run, rows=None):
    settings, robot, whole, documents = run
    header = header_of(settings, 7, Grade.SIM, 0)
    with LogWriter(path, {CONTROLLER: controller_table(robot.dof)}, header) as writer:
        for topic, record in documents:
            writer.write_json(topic, 0, with_bytes({"number": int(record["number"][0])}, record))
        writer.write_rows(CONTROLLER, whole if rows is None else rows)
    return path


def test_a_replay_is_identical_to_the_bit(tmp_path, run):
    result = replay.run([write(tmp_path / "log.mcap", run)])
    assert result.difference is None
    assert result.identical
    assert result.same_kernels
    assert result.ticks == len(run[2])
    assert result.commands == np.count_nonzero(run[2]["command_verb"])


@pytest.mark.parametrize(
    ("field", "index", "outputs"),
    [
        ("axis_angle_rad", 1, {"pose_measured"}),
        ("wrench_in_sensor", 2, {"wrench_in_base"}),
    ],
)
def test_one_changed_bit_of_an_input_is_found_at_its_tick(tmp_path, run, field, index, outputs):
    rows = run[2].copy()
    at = int(np.flatnonzero(rows["task_state"] == Task.INSERTING)[700])
    rows[field][at : at + 1].view("u8")[0, index] ^= 1 << 30  # far below what anybody would see
    difference = replay.run([write(tmp_path / "log.mcap", run, rows)]).difference
    assert difference is not None
    assert difference.tick == rows["tick"][at]
    assert difference.field in outputs
    assert difference.logged != difference.replayed


def test_a_changed_command_and_a_changed_output_are_found(tmp_path, run):
    rows = run[2].copy()
    at = int(np.flatnonzero(rows["command_verb"] == Verb.INSERT)[0])
    rows["command_argument"][at, 0] = 4.5
    difference = replay.run([write(tmp_path / "a.mcap", run, rows)]).difference
    assert difference is not None
    assert (difference.tick, difference.field) == (rows["tick"][at], "pose_goal")
    rows = run[2].copy()
    rows["command_applied_v"][4000, 2] = np.nextafter(rows["command_applied_v"][4000, 2], 9.0)
    difference = replay.run([write(tmp_path / "b.mcap", run, rows)]).difference
    assert difference is not None
    assert (difference.tick, difference.field) == (rows["tick"][4000], "command_applied_v")


def test_a_changed_parameter_set_is_found_where_it_takes_effect(tmp_path, run):
    settings, robot, rows, documents = run
    changed = [(t, r.copy()) for t, r in documents]
    changed[1][1]["integral"] *= 1.0 + 1e-12
    difference = replay.run([write(tmp_path / "log.mcap", (settings, robot, rows, changed))]).difference
    assert difference is not None
    at = rows["tick"][np.flatnonzero(rows["command_verb"] == Verb.SET_PARAMETERS)[0]]
    assert at <= difference.tick <= at + 20


def test_a_log_without_the_plan_it_used_is_refused(tmp_path, run):
    settings, robot, rows, documents = run
    with pytest.raises(RtctlError, match="lacks the plan"):
        replay.run([write(tmp_path / "log.mcap", (settings, robot, rows, documents[1:]))])


def test_a_log_with_a_gap_or_without_its_beginning_is_refused(tmp_path, run):
    rows = run[2]
    with pytest.raises(RtctlError, match="missing"):
        replay.run([write(tmp_path / "gap.mcap", run, np.delete(rows, 500))])
    with pytest.raises(RtctlError, match="does not begin"):
        replay.run([write(tmp_path / "late.mcap", run, rows[100:])])
