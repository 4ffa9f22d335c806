"""Calibrations from the command line: on the simulated bench, and through a client as the daemon has it."""

import tomllib

import numpy as np
import pytest

from rtctl.calibrate.simulated import SimulatedRobot
from rtctl.cli import calibrate_gravity, main
from rtctl.cli.exit_codes import Exit
from rtctl.client import Reply
from rtctl.commands import Verb
from rtctl.gateway.parameters import Parameters
from rtctl.settings import load

SENSOR = {"weight": np.array([0.1498, -0.4494]), "centre": np.array([3.0, -2.0, 25.0])}


class LockstepClient:
    """A client whose controller runs in lockstep in this process; time passes while it waits."""

    def __init__(self, simulated: SimulatedRobot, tmp_path) -> None:
        self._simulated = simulated
        self._parameters = Parameters(simulated.settings, simulated.robot, tmp_path)
        self.stopped = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def command(self, verb, *arguments):
        return Reply(tick=self._simulated.operator.command(verb, *arguments))

    def wait(self, done, timeout_s):
        return self._simulated.operator.wait(lambda r: r is not None and done(r), timeout_s)

    def latest(self):
        return self._simulated.operator.wait(lambda _: True, 0.0)

    def parameters(self, *_):
        return self._parameters.values()

    def status(self):
        return {}

    def stop(self):
        self.stopped += 1


@pytest.fixture
def daemon(monkeypatch, tmp_path):
    """A homed robot in the middle of its workspace, and the client that the command gets."""
    settings = load("planar-sim")
    simulated = SimulatedRobot(settings, 0)
    simulated.script(("middle",)).move("middle", simulated.middle(), settings)
    client = LockstepClient(simulated, tmp_path)
    monkeypatch.setattr(calibrate_gravity, "connect", lambda *_: client)
    monkeypatch.chdir(tmp_path)
    return client


def only_file(folder):
    (file,) = folder.glob("*.toml")
    return file


def check_gravity(file):
    table = tomllib.loads(file.read_text())["wrench"]
    assert table["gravity_force_in_base_n"][:2] == pytest.approx(SENSOR["weight"], abs=0.01)
    assert table["centre_of_mass_in_sensor_mm"] == pytest.approx(SENSOR["centre"], abs=1.2)
    assert load("planar-sim", [f"@{file}"]).wrench.gravity_force_in_base_n == tuple(table["gravity_force_in_base_n"])


def test_gravity_through_the_daemon_is_kept_with_its_origin(daemon, tmp_path, capsys):
    assert main(["calibrate", "gravity", "--poses", "6"]) == Exit.OK
    captured = capsys.readouterr()
    assert "weight in {B}" in captured.out
    assert "cannot be told from bias" in captured.err
    file = only_file(tmp_path)
    assert file.name.startswith("planar-gravity-20")
    assert f"--set @{file.name}" in captured.out
    text = file.read_text()
    for words in ("# robot: planar (planar_3rpr)", "the controller at tcp/", "6 poses, linear fit", "# left at poses the fit had not seen"):  # fmt: skip
        assert words in text
    check_gravity(file)
    assert daemon.stopped == 0


def test_gravity_with_an_array_in_the_gripper_moves_nothing(daemon, tmp_path, capsys):
    daemon.command(Verb.LOAD_ARRAY)
    before = np.array(daemon.latest()["pose_measured"])
    assert main(["calibrate", "gravity"]) == Exit.FAILED
    assert "array is loaded" in capsys.readouterr().err
    assert daemon.latest()["pose_measured"] == pytest.approx(before, abs=1e-3)
    assert list(tmp_path.glob("*.toml")) == []


def test_gravity_on_the_simulated_bench(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = ["calibrate", "gravity", "--sim", "planar-sim", "--seed", "4", "--poses", "6", "--to", "g.toml"]
    assert main(arguments) == Exit.OK
    check_gravity(tmp_path / "g.toml")
    assert main(arguments) == Exit.BAD_INPUT
    assert "not overwritten" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("extra", "code", "message"),
    [
        (["--set", "backend.options.sensor.force_noise_n=1"], Exit.FAILED, "too much force is left"),
        (["--set", "backend.options.inject.wrench_silent_after_s=0"], Exit.FAILED, "no valid reading"),
        (["--method", "sphere"], Exit.FAILED, "determine no sphere"),
        (["--method", "cube"], Exit.BAD_INPUT, "one of linear, sphere"),
    ],
)
def test_a_bad_gravity_calibration_leaves_no_file(monkeypatch, tmp_path, capsys, extra, code, message):
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "gravity", "--sim", "planar-sim", "--poses", "6", *extra]) == code
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_running_controller_has_its_settings_already(capsys):
    assert main(["calibrate", "gravity", "--set", "wrench.unbias_s=1"]) == Exit.BAD_INPUT
    assert "belong to --sim" in capsys.readouterr().err


def test_from_tracked_poses_to_settings(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "record", "poses.csv", "planar-sim", "--poses", "16"]) == Exit.OK
    assert main(["calibrate", "backlash", "poses.csv", "planar-sim"]) == Exit.OK
    out = capsys.readouterr().out
    assert "backlash [rad]" in out
    file = only_file(tmp_path)
    table = tomllib.loads(file.read_text())
    assert table["control"]["backlash_rad"] == pytest.approx([1.9, 2.4, 1.5, 0.0], abs=0.03)
    settings = load("planar-sim", [f"@{file}"])
    assert settings.robot.geometry["eta_mm_per_rad"] == pytest.approx([0.09703, 0.09698, 0.09702], abs=3e-5)
    assert settings.robot.geometry["stroke_min_mm"] == [-0.3, -0.3, -0.3], "what is not calibrated stays"
    assert "poses.csv, sha256 " in file.read_text()


def test_bad_poses_are_told(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "poses.csv").write_text("x_mm,y_mm\n1,2\n")
    assert main(["calibrate", "backlash", "poses.csv"]) == Exit.BAD_INPUT
    assert "columns" in capsys.readouterr().err
    assert main(["calibrate", "backlash", "nowhere.csv"]) == Exit.BAD_INPUT


def test_stiffness_of_a_rope(tmp_path, capsys):
    file = tmp_path / "rope.csv"
    elongation = np.linspace(0.0, 2.0, 201)
    file.write_text("elongation_mm,tension_n\n" + "".join(f"{y:.4f},{25.6 * y:.5f}\n" for y in elongation))
    assert main(["calibrate", "stiffness", str(file), "--length", "125", "--points", "3"]) == Exit.OK
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    assert rows == [
        ["0.000", "0.0", "25.60", "3200"],
        ["1.000", "25.6", "25.60", "3200"],
        ["2.000", "51.2", "25.60", "3200"],
    ]
    file.write_text("elongation_mm,tension_n\n1,2\n")
    assert main(["calibrate", "stiffness", str(file), "--length", "125"]) == Exit.FAILED
    assert "too few samples" in capsys.readouterr().err
