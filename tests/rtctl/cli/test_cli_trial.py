"""Short forms of settings: what they stand for, never beside the long form, and bounds that are told."""

import json

import pytest

from hal.errors import OptionError
from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.cli.trial import GRAVITY, KEYS, SIDE, settings_with
from rtctl.settings import load

VALUES = {
    "--specimen": "bone",
    "--size": 3.6,
    "--lateral": -0.25,
    "--out-of-plane": 0.5,
    "--angle": -1e-5,
    "--stylet-offset": 0.5,
    "--speed": 2.0,
    "--scatter": True,
}


def assigned(option, value):
    return f"{KEYS[option]}={str(value).lower()}"


@pytest.mark.parametrize("option", VALUES)
def test_an_option_is_short_for_its_setting(option):
    value = VALUES[option]
    assert settings_with("planar-sim", [], {option: value}) == load("planar-sim", [assigned(option, value)])


def test_options_go_together_and_with_other_settings():
    every = [assigned(option, value) for option, value in VALUES.items()]
    overrides = ["workflow.depth_mm=3.0", "backend.options.trial.side=left"]
    assert settings_with("planar-sim", overrides, VALUES) == load("planar-sim", [*overrides, *every])
    assert settings_with("planar-sim", overrides, dict.fromkeys(KEYS)) == load("planar-sim", overrides)


def test_for_the_other_ear_the_controller_knows_that_it_is_turned_over():
    right, left = (settings_with("planar-sim", [], {"--side": side}) for side in ("right", "left"))
    assert right == load("planar-sim", [f"{SIDE}=right"])
    x, y, z = right.wrench.gravity_force_in_base_n
    assert left == load("planar-sim", [f"{SIDE}=left", "cochlea.side=left", f"{GRAVITY}=[{x}, {-y}, {-z}]"])


def test_a_file_for_a_left_ear_has_its_gravity_already(tmp_path):
    file = tmp_path / "left.toml"
    file.write_text(
        "[cochlea]\nside = 'left'\n[backend.options.trial]\nside = 'left'\n[wrench]\ngravity_force_in_base_n = [0.1, 0.4, 1.4]\n"
    )
    kept, turned = (settings_with(str(file), [], {"--side": side}) for side in ("left", "right"))
    assert kept == load(file)
    assert turned.wrench.gravity_force_in_base_n == (0.1, -0.4, -1.4)
    assert turned.backend.options["trial"]["side"] == turned.cochlea.side == "right"


@pytest.mark.parametrize(
    ("option", "value", "assignment"),
    [
        ("--lateral", 0.1, "backend.options.trial.lateral_mm=0.2"),
        ("--lateral", 0.1, " backend.options.trial={ lateral_mm = 0.2 }"),
        ("--speed", 1.0, "workflow.speed_mm_per_s = 1.0"),
        ("--side", "left", f"{GRAVITY}=[0, 0, 1]"),
        ("--side", "right", f"{SIDE}=right"),
        ("--scatter", False, "backend.options.trial.scatter=true"),
    ],
)
def test_the_short_and_the_long_form_together_are_refused(option, value, assignment):
    with pytest.raises(OptionError, match=rf"^{option} and --set {assignment.strip()[:20]}.*leave one of them out"):
        settings_with("planar-sim", ["loop.priority=70", assignment.strip()], {option: value})


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--specimen", "wood"], "got 'wood' (allowed: phantom | bone)"),
        (["--size", "5"], "got 5.0 (allowed: 3.2 .. 4.6 mm)"),
        (["--side", "middle"], "got 'middle' (allowed: right | left)"),
        (["--lateral", "-4"], "got -4.0 (allowed: -3 .. 3 mm)"),
        (["--out-of-plane", "4"], "got 4.0 (allowed: -3 .. 3 mm)"),
        (["--angle", "0.4"], "got 0.4 (allowed: -0.3 .. 0.3 rad)"),
        (["--stylet-offset", "9"], "got 9.0 (allowed: -3 .. 3 mm)"),
        (["--speed", "0"], "got 0.0 (allowed: 0.05 .. 5 mm/s)"),
        (["--speed", "nan"], "must be a finite number"),
        (["--speed", "4"], "at most trajectory.depth_speed_mm_per_s = 3.0"),
    ],
)
def test_values_out_of_bounds_are_refused_with_the_bound(words, told, capsys):
    assert main(["sim", *words]) == Exit.BAD_INPUT
    captured = capsys.readouterr()
    assert told in captured.err
    assert captured.out == ""


def test_turned_over_the_robot_still_feels_nothing_where_there_is_nothing(capsys):
    """Bench and controller agree about the other ear; if only the bench is turned over, weight looks like contact."""

    def peak(*words):
        in_air = ["backend.options.anatomy.entry_in_base_mm=[400.0, 0.0]", "admittance.lateral=false"]
        assert main(["sim", "--set", in_air[0], "--set", in_air[1], *words, "--json"]) == Exit.OK
        return json.loads(capsys.readouterr().out)["insertion_force_peak_n"]

    assert peak("--side", "right") < 0.03
    assert peak("--side", "left") < 0.03
    assert peak("--set", f"{SIDE}=left") > 0.1
