"""From logs to profiles and back: what is trained on is what the tick looks at, and what the command makes of it."""

import json
import shutil

import numpy as np
import pytest

from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.guidance import buckling, dataset, detector_file, training
from rtctl.guidance.dataset import synthesise
from rtctl.guidance.features import SAMPLES
from rtctl.guidance.folding import KNOWN
from rtctl.guidance.svm import TrainingError
from rtctl.recording import open_recording
from rtctl.report import detection
from rtctl.settings import load
from rtctl.simulation import simulate
from rtctl.summary import Run

WHOLE = ("workflow.depth_mm=13.9", "workflow.hold_s=0.1")


@pytest.fixture(scope="module")
def logs(detector, tmp_path_factory):
    """A folder with the log of one insertion into the simulated cochlea, watched by a detector that only warns."""
    folder = tmp_path_factory.mktemp("logs")
    detector_file.write(detector, folder / "detector.json")
    settings = load("planar-sim", [*WHOLE, f"guidance.detector={folder / 'detector.json'}"])
    result = simulate(settings, 5, log=folder / "5.mcap")
    assert result.failure is None
    return folder


def test_a_profile_from_a_log_is_what_the_tick_looked_at(logs, detector):
    data = dataset.collect([logs])
    rows = open_recording([logs / "5.mcap"]).records
    assert data.profiles.shape == (1, 3, SAMPLES)
    at = np.flatnonzero(np.diff(rows["detector_samples"]) > 0) + 1
    assert len(at) == SAMPLES
    assert rows["force_axial_n"][at] == pytest.approx(data.profiles[0, 0], abs=1e-12)
    early = detector.folding.decide_early(detector.forces, data.profiles)[0]
    assert rows["fold_decision"][at[KNOWN - 1]] == pytest.approx(early, abs=1e-8)
    integrals = buckling.integrals(data.profiles)[0]
    assert pytest.approx(integrals, abs=1e-9) == rows["buckling_integral"][at].T


def test_the_simulation_knows_the_class_and_a_label_overrules_it(logs, tmp_path):
    assert dataset.collect([logs]).classes.tolist() == ["normal"]
    shutil.copy(logs / "5.mcap", tmp_path / "5.mcap")
    (tmp_path / "labels.csv").write_text("file,class\n5.mcap,fold\n")
    assert dataset.collect([tmp_path]).classes.tolist() == ["fold"]
    (tmp_path / "labels.csv").write_text("file,class\n5.mcap,strange\n")
    with pytest.raises(TrainingError, match="no class that is known"):
        dataset.collect([tmp_path])
    (tmp_path / "labels.csv").write_text("name,what\n5.mcap,fold\n")
    with pytest.raises(TrainingError, match="labels cannot be read"):
        dataset.collect([tmp_path])


def test_an_insertion_that_ended_early_is_left_out_and_told(logs, insertion, tmp_path):
    shutil.copy(logs / "5.mcap", tmp_path / "whole.mcap")
    (tmp_path / "run").mkdir()
    shutil.copy(insertion.log, tmp_path / "run" / "log.mcap")
    data = dataset.collect([tmp_path])
    assert len(data.profiles) == 1
    assert data.skipped == ("run: it ended at 4.0 mm, before 13.8 mm",)
    with pytest.raises(TrainingError, match="no log holds a whole insertion"):
        dataset.collect([tmp_path / "nowhere"])


def test_the_report_shows_the_detectors_only_where_they_watched(logs, insertion):
    assert detection.draw(Run(insertion.simulation.recording)) is None
    figure = detection.draw(Run(open_recording([logs / "5.mcap"])))
    assert figure is not None
    force, decision = figure.axes
    curves = {line.get_label(): line.get_ydata() for line in (*force.lines, *decision.lines)}
    rows = open_recording([logs / "5.mcap"]).records
    at = np.flatnonzero(np.diff(rows["detector_samples"]) > 0) + 1
    assert curves["measured"] == pytest.approx(-1e3 * rows["force_axial_n"][at])
    assert curves["h"] == pytest.approx(rows["fold_decision"][at], nan_ok=True)


@pytest.mark.parametrize(("normal", "fold", "name"), [(9, 20, "normal"), (20, 9, "fold"), (20, 0, "fold")])
def test_too_few_insertions_of_a_class_are_refused(normal, fold, name):
    with pytest.raises(TrainingError, match=f"too few insertions of class {name}"):
        training.train(synthesise(0, normal, fold))


def test_a_dead_sensor_is_refused():
    data = synthesise(0, 12, 12)
    data.profiles[:, 2] = 0.0
    with pytest.raises(TrainingError, match="the same in all insertions"):
        training.train(data, reference_forces=True)
    data.profiles[3, 0, 5] = np.nan
    with pytest.raises(TrainingError, match="not finite"):
        training.train(data)


def test_the_same_seed_gives_the_same_insertions_and_another_does_not():
    assert synthesise(3, 4, 4, 4).digest == synthesise(3, 4, 4, 4).digest
    assert synthesise(3, 4, 4, 4).digest != synthesise(4, 4, 4, 4).digest


def test_syn_1_scatters_as_the_specification_says():
    """The deviation over insertions of the mean force is 0.0199 N."""
    forces = synthesise(0, 4000, 0).profiles[:, 0]
    assert forces.mean(axis=1).std(ddof=1) == pytest.approx(0.0199, abs=0.0008)


def test_the_command_trains_and_judges(tmp_path, capsys):
    file = tmp_path / "detector.json"
    assert main(["detector", "train", "SYN-1", "--to", str(file), "--seed", "2"]) == Exit.OK
    assert "51 normal, 56 fold" in capsys.readouterr().out
    assert json.loads(file.read_text())["provenance"]["data"] == "SYN-1 (simulated), seed 2"
    assert main(["detector", "evaluate", str(file), "SYN-1", "--splits", "2", "--json"]) == Exit.OK
    told = json.loads(capsys.readouterr().out)
    assert [m["margin"] for m in told["margins"]] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert told["counts"] == {"normal": 300, "fold": 300, "buckle": 300}
    assert set(told["methods"]) == {"1", "2", "3", "4"}
    assert main(["detector", "evaluate", str(file), "SYN-1", "--splits", "0"]) == Exit.OK
    assert "simulated" in capsys.readouterr().out


@pytest.mark.parametrize("data", ["no-such-folder", "."])
def test_the_command_says_what_is_wrong_with_the_data(tmp_path, monkeypatch, capsys, data):
    monkeypatch.chdir(tmp_path)
    assert main(["detector", "train", data, "--to", "d.json"]) in (Exit.BAD_INPUT, Exit.DATA)
    assert "folder" in capsys.readouterr().err
    assert not (tmp_path / "d.json").exists()
