"""``rtctl plan``: make, show, plot, check, load, and a simulated insertion along a file."""

import json
import xml.etree.ElementTree as ElementTree

import pytest

from rtctl.cli import main, plan
from rtctl.cli.exit_codes import Exit
from rtctl.client import Reply

SHORT = ["--set", "workflow.depth_mm=2.0", "--set", "workflow.hold_s=0.0"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    file = tmp_path_factory.mktemp("plans") / "plan.json"
    assert main(["plan", "make", "planar-sim", "--to", str(file)]) == Exit.OK
    return file


def test_make_says_what_was_made(tmp_path, capsys):
    file = tmp_path / "mine.json"
    arguments = ["plan", "make", "--to", str(file), "--entry", "172.2", "4.7", "-0.01", "--set", "cochlea.side=left"]
    assert main(arguments) == Exit.OK
    assert "31 depths to 15 mm" in capsys.readouterr().out
    content = json.loads(file.read_text())
    assert content["checked"]["entry_pose_mm_rad"] == [172.2, 4.7, -0.01]
    assert content["cochlea"] == {"spiral_a_mm": 3.84, "side": "left"}


def test_no_file_is_written_for_a_plan_that_is_refused(tmp_path, capsys):
    file = tmp_path / "mine.json"
    assert main(["plan", "make", "--to", str(file), "--entry", "190", "0", "0"]) == Exit.FAILED
    assert "the robot cannot follow the plan" in capsys.readouterr().err
    assert not file.exists()


def test_show_has_a_row_a_depth(made, capsys):
    assert main(["plan", "show", str(made)]) == Exit.OK
    lines = capsys.readouterr().out.splitlines()
    assert any("depth [mm]" in line and "phi [rad]" in line for line in lines)
    rows = [line.split() for line in lines if len(line.split()) == 7 and line.split()[0].replace(".", "").isdigit()]
    content = json.loads(made.read_text())["depths"]
    assert [float(row[0]) for row in rows] == content["depth_mm"]
    assert [float(row[4]) for row in rows] == pytest.approx(content["stylet_mm"], abs=5e-4)
    assert main(["plan", "show", str(made), "--json"]) == Exit.OK
    assert json.loads(capsys.readouterr().out) == json.loads(made.read_text())


@pytest.mark.parametrize("name", ["plan.svg", "plan.png"])
def test_plot_draws_a_picture(made, tmp_path, name):
    picture = tmp_path / name
    assert main(["plan", "plot", str(made), "--to", str(picture)]) == Exit.OK
    if name.endswith("svg"):
        assert ElementTree.parse(picture).getroot().tag.endswith("svg")
    else:
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_plot_refuses_other_pictures(made, tmp_path, capsys):
    assert main(["plan", "plot", str(made), "--to", str(tmp_path / "plan.bmp")]) == Exit.FAILED
    assert ".svg or .png" in capsys.readouterr().err


def test_check_tells_good_from_bad(made, capsys):
    assert main(["plan", "check", str(made)]) == Exit.OK
    assert "is good for planar-sim" in capsys.readouterr().out
    assert main(["plan", "check", str(made), "--set", "cochlea.spiral_a_mm=3.5"]) == Exit.FAILED
    assert "another cochlea: got 3.84 (allowed: cochlea.spiral_a_mm = 3.5)" in capsys.readouterr().err
    assert main(["plan", "check", str(made.parent / "none.json")]) == Exit.BAD_INPUT


def test_a_simulation_follows_the_file_to_the_same_bytes(made, tmp_path, monkeypatch):
    logs = [tmp_path / "planned.mcap", tmp_path / "loaded.mcap"]
    assert main(["sim", *SHORT, "--log", str(logs[0])]) == Exit.OK
    monkeypatch.setattr("rtctl.planner.plan_insertion", None)  # nobody plans anew
    assert main(["sim", *SHORT, "--log", str(logs[1]), "--plan", str(made)]) == Exit.OK
    assert logs[0].read_bytes() == logs[1].read_bytes()


def test_a_simulation_refuses_a_plan_for_another_robot(made, capsys):
    assert main(["sim", "--plan", str(made), "--set", "robot.geometry.a_mm=[63.2,63.2,63.9]"]) == Exit.FAILED
    assert "another robot" in capsys.readouterr().err


def test_many_simulations_have_no_one_plan(made, tmp_path, capsys):
    assert main(["sim", "--count", "2", "--to", str(tmp_path / "t.csv"), "--plan", str(made)]) == Exit.BAD_INPUT
    assert "leave out --count" in capsys.readouterr().err


class Controller:
    def __init__(self):
        self.documents = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def plan(self, document=None):
        self.documents.append(document)
        return Reply(tick=7, result={"number": 4})


@pytest.fixture
def controller(monkeypatch):
    made = Controller()
    monkeypatch.setattr(plan, "connect", lambda *_: made)
    return made


def test_load_sends_the_document(made, controller, capsys):
    assert main(["plan", "load", str(made)]) == Exit.OK
    assert controller.documents == [json.loads(made.read_text())]
    assert capsys.readouterr().out == "plan 4 is in force from tick 7\n"


def test_without_a_word_the_controller_plans(controller):
    assert main(["plan"]) == Exit.OK
    assert controller.documents == [None]


def test_the_robot_is_named_behind_the_word(made, controller, capsys):
    assert main(["plan", "--robot", "other", "load", str(made)]) == Exit.BAD_INPUT
    assert "--robot belongs behind the word load" in capsys.readouterr().err
    assert controller.documents == []
