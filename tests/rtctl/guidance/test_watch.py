"""The detectors in the tick: equal to their definitions, and what happens when they find something."""

import json

import numpy as np
import pytest

from hal.kernel import kernel
from rtctl import replay
from rtctl.commands import Reason, Verb
from rtctl.exchange.control import Grade
from rtctl.gateway.events import Watcher
from rtctl.gateway.journal import with_bytes
from rtctl.gateway.setup import header_of
from rtctl.guidance import buckling, layout, watch
from rtctl.guidance.dataset import synthesise
from rtctl.guidance.features import GRID, SAMPLES
from rtctl.guidance.folding import KNOWN
from rtctl.guidance.force_model import FULL_DEPTH_MM, basis
from rtctl.guidance.prediction import predict
from rtctl.lifecycle import Condition, Operating, Task
from rtctl.log.format import CONTROLLER, PLANS
from rtctl.log.writer import LogWriter
from rtctl.record import controller_table
from rtctl.wrench import into_sensor

MARGIN = 0.75


def followed(packed, profile):
    """The state (97,) after each sample of a profile (3, 97)."""
    insertion: np.ndarray = np.zeros(1, layout.INSERTION)
    watch.forget(insertion[0])
    states = []
    for forces in profile.T:
        watch.take(packed[0], insertion[0], *forces)
        watch.decide(packed[0], insertion[0], MARGIN, 0)
        states.append(insertion[0].copy())
    return np.array(states)


@kernel
def watch_arrays(memory, record):
    watch.watch(memory[0], record[0])


@pytest.fixture(scope="module")
def packed(detector):
    return layout.pack(detector)


@pytest.fixture(scope="module")
def fresh():
    return synthesise(21, 6, 10, 10)


def test_decision_and_bound_are_those_of_the_definition(detector, packed, fresh):
    early = detector.folding.decide_early(detector.forces, fresh.profiles)
    found = detector.folding.detected(early, MARGIN)
    assert (found > 0).any()
    for profile, h, first in zip(fresh.profiles, early, found, strict=True):
        states = followed(packed, profile)
        assert states["decision"][KNOWN - 1] == pytest.approx(h, abs=1e-8)
        assert states["decision_bound"][KNOWN - 1] == pytest.approx(MARGIN * detector.folding.bound)
        flagged = (states["flags"] & layout.FOLDED) != 0
        assert (np.flatnonzero(flagged)[0] + 1 if flagged.any() else -1) == first
        assert flagged[flagged.argmax() :].all() or not flagged.any(), "latched"
        assert np.isnan(states["decision"][: KNOWN[0] - 1]).all()


def test_integrals_and_their_verdict_are_those_of_the_definition(detector, packed, fresh):
    found = buckling.detected(detector.buckling, fresh.profiles)
    assert (found >= 0).any()
    for profile, first in zip(fresh.profiles, found, strict=True):
        states = followed(packed, profile)
        assert pytest.approx(buckling.integrals(profile[None])[0], abs=1e-9) == states["integral"].T
        flagged = (states["flags"] & layout.BUCKLED) != 0
        assert (np.flatnonzero(flagged)[0] if flagged.any() else -1) == first


def test_the_last_force_is_the_predicted_one(detector, packed, fresh):
    states = followed(packed, fresh.profiles[0])
    for k in (1, 5, 40, 96):
        last = predict(detector.forces, GRID, fresh.profiles[0][:, :k]) @ basis(np.ones(1)).T
        assert states["predicted_force_n"][k - 1] == pytest.approx(last[0, 0], abs=1e-9)


@pytest.fixture(scope="module")
def files(table, tmp_path_factory):
    """Detector files: as trained, one that calls everything a fold, one that calls everything buckling."""
    folder = tmp_path_factory.mktemp("detectors")
    fold = json.loads(json.dumps(table))
    fold["folding"]["b"] = -1e5
    buckle = json.loads(json.dumps(table))
    buckle["folding"]["b"] = 1e5
    buckle["buckling"]["mean"] = (np.array(buckle["buckling"]["mean"]) - 10.0 * GRID).tolist()
    buckle["buckling"]["deviation"] = np.zeros((2, SAMPLES)).tolist()
    paths = {}
    for name, content in (("trained", table), ("fold", fold), ("buckle", buckle)):
        paths[name] = folder / f"{name}.json"
        paths[name].write_text(json.dumps(content))
    return paths


def inserting(make_rig, file, *more):
    rig = make_rig(f"guidance.detector={file}", *more).at_entry()
    rig.do(Verb.INSERT, 6.0, 2.0)
    return rig


def test_in_a_closed_loop_the_samples_are_those_of_the_record(make_rig, files, detector):
    rig = inserting(make_rig, files["trained"])
    rig.until(lambda r: r["task_state"] == Task.HOLDING)
    rows = rig.rows
    at = np.flatnonzero(np.diff(rows["detector_samples"]) > 0) + 1
    samples = rows["detector_samples"][at]
    assert samples.tolist() == list(range(1, len(at) + 1))
    depth = rows["depth_mm"][at - 1]  # the tick begins with the setpoint of the last one
    assert (depth >= GRID[: len(at)] * FULL_DEPTH_MM).all()
    assert (rows["depth_mm"][at - 2] < GRID[: len(at)] * FULL_DEPTH_MM)[1:].all()
    moment, forces = np.zeros(3), []
    for row in rows[at]:
        into_sensor(rig.robot.rotation(row["pose_measured"]), np.array(row["wrench_in_base"][3:]), moment)
        forces.append((row["force_axial_n"], moment[0], moment[1]))
    profile = np.zeros((3, SAMPLES))
    profile[:, : len(at)] = np.array(forces).T
    early = detector.folding.decide_early(detector.forces, profile[None])[0]
    decided = KNOWN[len(at) >= KNOWN]
    assert len(decided) > 15
    assert rows["fold_decision"][at[decided - 1]] == pytest.approx(early[: len(decided)], abs=1e-8)
    integrals = buckling.integrals(profile[None])[0][:, : len(at)]
    assert pytest.approx(integrals, abs=1e-9) == rows["buckling_integral"][at].T
    assert (rows["detector_flags"][at] & layout.WATCHING).all()
    assert not rows["detector_flags"][-1] & layout.WATCHING


@pytest.mark.parametrize(
    ("file", "option", "note", "pause"),
    [
        ("fold", "tip_fold", Condition.TIP_FOLD_WARNING, Condition.TIP_FOLD),
        ("buckle", "buckling", Condition.BUCKLING_WARNING, Condition.BUCKLING),
    ],
)
class TestReactions:
    def test_a_warning_is_told_and_changes_nothing(self, make_rig, files, file, option, note, pause):
        rig = inserting(make_rig, files[file])
        rig.until(lambda r: r["task_state"] == Task.HOLDING)
        rows = rig.rows
        assert (rows["condition_active"] >> note & 1).any()
        assert not (rows["condition_active"] >> pause & 1).any()
        assert (rows["operating_state"][rows["is_homed"] == 1] == Operating.ENABLED).all()
        events = [e for e in Watcher().watch(rows) if e.kind == "condition" and e.severity == "warning"]
        assert len(events) == 1, option
        assert events[0].value is not None

    def test_a_pause_pauses_once_and_can_be_resumed(self, make_rig, files, file, option, note, pause):
        rig = inserting(make_rig, files[file], f"guidance.{option}=pause")
        rig.until(lambda r: r["operating_state"] == Operating.PAUSED)
        assert rig.last["stop_cause"] == pause
        assert not (rig.rows["condition_active"] >> note & 1).any()
        rig.run(2000)
        assert rig.last["depth_rate_mm_per_s"] == 0.0
        rig.do(Verb.RESUME)
        rig.until(lambda r: r["task_state"] == Task.HOLDING and r["depth_mm"] > 5.99)

    def test_retract_leaves_one_way_which_is_out(self, make_rig, files, file, option, note, pause):
        rig = inserting(make_rig, files[file], f"guidance.{option}=retract")
        rig.until(lambda r: r["operating_state"] == Operating.PAUSED)
        rig.run(2000)
        deepest = rig.last["depth_mm"]
        for verb, *arguments in ((Verb.RESUME,), (Verb.INSERT, 6.0, 1.0)):
            rig.order(verb, *arguments)
            rig.run(500)
            assert rig.last["depth_mm"] == deepest
            assert rig.last["operating_state"] == Operating.PAUSED
        rig.do(Verb.RETRACT, 0.0, 2.0)
        rig.until(lambda r: r["task_state"] == Task.DONE)
        rig.run(5)
        assert rig.last["operating_state"] == Operating.ENABLED
        assert not rig.last["condition_active"] >> pause & 1, note
        assert (rig.last["detector_samples"], rig.last["detector_flags"]) == (0, 0)


def test_without_a_detector_nothing_is_known(entry):
    entry.do(Verb.INSERT, 1.0, 2.0)
    rows = entry.run(300)
    assert not rows["detector_samples"].any()
    assert not rows["detector_flags"].any()
    for name in ("predicted_force_n", "fold_decision", "fold_bound", "buckling_integral", "buckling_bound"):
        assert np.isnan(rows[name]).all(), name


def test_a_sample_that_was_passed_by_makes_it_blind_not_wrong(make_rig, files):
    rig = inserting(make_rig, files["fold"])
    rig.until(lambda r: r["depth_mm"] > 2.0, step=1)
    assert rig.last["detector_flags"] & layout.FOLDED
    known = rig.last["detector_samples"]
    rig.state["setpoint"][3] += 0.3  # as if ticks had been missed, and the depth not
    row = rig.run(1)[0]
    assert row["detector_flags"] == layout.BLIND | layout.FOLDED
    assert row["condition_active"] >> Condition.DETECTOR_BLIND & 1
    for name in ("predicted_force_n", "fold_decision", "fold_bound", "buckling_integral", "buckling_bound"):
        assert np.isnan(row[name]).all(), name
    assert rig.run(500)["detector_samples"][-1] == known, "for the rest of this insertion"


def test_an_unknown_force_is_waited_for(make_rig, files):
    rig = inserting(make_rig, files["trained"])
    rig.until(lambda r: r["detector_samples"] == 10, step=1)
    memory = rig.controller.memory
    memory["state"]["setpoint"][0, 3] = 10.2 / 96 * FULL_DEPTH_MM
    record = rig.last.copy()
    record["force_axial_n"] = np.nan
    for force, samples in ((np.nan, 10), (-0.05, 11)):
        record["force_axial_n"] = force
        watch_arrays(memory, record.reshape(1))
        assert memory["insertion"]["samples"][0] == samples


def test_a_replay_needs_no_file_and_is_the_same_to_the_bit(make_rig, files, tmp_path):
    file = tmp_path / "moved.json"
    file.write_text(files["trained"].read_text())
    rig = inserting(make_rig, file)
    rig.run(1500)
    rows, plan = rig.rows, rig.controller.memory["plan"].copy()
    assert rows["detector_samples"][-1] > 10
    file.unlink()
    path = tmp_path / "log.mcap"
    with LogWriter(
        path, {CONTROLLER: controller_table(rig.robot.dof)}, header_of(rig.settings, 1, Grade.SIM, 0)
    ) as log:
        log.write_rows(CONTROLLER, rows)
        log.write_json(PLANS, 0, with_bytes({"number": 1}, plan))
    assert replay.run([path]).identical


def test_a_new_margin_counts_from_the_next_decision(make_rig, files):
    rig = inserting(make_rig, files["trained"])
    rig.until(lambda r: r["detector_samples"] == 10, step=1)
    before = rig.last["fold_bound"]
    memory = rig.controller.memory
    memory["staged_parameters"] = memory["parameters"]
    memory["staged_parameters"]["number"], memory["staged_parameters"]["fold_margin"] = 2, 0.0
    rig.do(Verb.SET_PARAMETERS, 2.0)
    rig.until(lambda r: r["detector_samples"] == 12, step=1)
    assert before > 0.0 == rig.last["fold_bound"]
    assert rig.order(Verb.STOP) is Reason.ACCEPTED
