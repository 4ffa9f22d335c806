"""``rtctl calibrate array`` and ``shape``: from a file of points to settings that can be used."""

import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.electrode.digitised import read
from rtctl.electrode.image_calibration import calibrate_images
from rtctl.settings import load

EXAMPLE = Path(__file__).resolve().parents[3] / "docs" / "examples" / "array.csv"


@pytest.fixture(autouse=True)
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_array_prints_its_residuals_and_leaves_settings(workplace, capsys):
    assert main(["calibrate", "array", str(EXAMPLE), "--to", "mine.toml", "--figure", "shapes.svg"]) == Exit.OK
    found, out = calibrate_images(read(EXAMPLE)), capsys.readouterr().out
    assert f"residual {found.rms_rad:.4f} rad rms over 13 images, 299 chords" in out
    rows = [line.split() for line in out.splitlines()]
    for image, rms in zip(found.images, found.image_rms_rad, strict=True):
        assert [image.name, f"{image.stylet_mm:g}", "24", f"{image.arc_mm[-1]:.2f}", f"{rms:.4f}"] in rows
    text = (workplace / "mine.toml").read_text()
    assert np.array(tomllib.loads(text)["electrode"]["modal_matrix"]) == pytest.approx(found.modal_matrix, rel=1e-15)
    for words in ("# made: 20", "# from: array.csv, sha256 ", "rad rms; worst image"):
        assert words in text
    assert ElementTree.parse("shapes.svg").getroot().tag.endswith("svg")


def test_the_result_is_used_by_planning():
    assert main(["calibrate", "array", str(EXAMPLE), "--to", "mine.toml"]) == Exit.OK
    settings = load("planar-sim", ["@mine.toml"])
    assert np.array(settings.electrode.modal_matrix) == pytest.approx(calibrate_images(read(EXAMPLE)).modal_matrix)
    arguments = [
        "--set",
        "@mine.toml",
        "--set",
        "trajectory.speed_rad_per_s=1.0",
        "--set",
        "workflow.speed_mm_per_s=0.5",
    ]
    assert main(["plan", "make", *arguments, "--to", "plan.json"]) == Exit.OK
    assert main(["plan", "check", "plan.json", *arguments]) == Exit.OK
    assert main(["plan", "check", "plan.json"]) == Exit.FAILED  # the array of the settings is another one


def test_without_a_name_the_result_is_named_by_file_and_day_and_never_overwritten(workplace, capsys):
    assert main(["calibrate", "array", str(EXAMPLE)]) == Exit.OK
    (file,) = workplace.glob("array-20??-??-??.toml")
    assert f"--set @{file.name}" in capsys.readouterr().out
    assert main(["calibrate", "array", str(EXAMPLE), "--to", file.name]) == Exit.BAD_INPUT
    assert "not overwritten" in capsys.readouterr().err


def test_an_image_with_a_wrong_withdrawal_is_pointed_out(workplace, capsys):
    text = EXAMPLE.read_text().replace("\n06,6.35,", "\n06,10.16,")
    (workplace / "points.csv").write_text(text)
    assert main(["calibrate", "array", "points.csv"]) == Exit.OK
    remarks = capsys.readouterr().err
    assert "image 06 fits worse than the others" in remarks
    assert "image 01" not in remarks


def test_a_bad_file_leaves_nothing(workplace, capsys):
    (workplace / "points.csv").write_text("image,stylet_mm,x_mm,y_mm\n1,0,0,zero\n")
    assert main(["calibrate", "array", "points.csv"]) == Exit.BAD_INPUT
    assert "line 2: y_mm is not a number" in capsys.readouterr().err
    assert [p.name for p in workplace.iterdir()] == ["points.csv"]


def test_shape_from_the_synthetic_arrays(workplace, capsys):
    assert main(["calibrate", "shape", "--point", "16.7742445", "3.4374196", "--to", "mine.toml"]) == Exit.OK
    captured = capsys.readouterr()
    assert "17.1579 mm" in captured.out
    assert "0.263749 rad" in captured.out
    assert "seven synthetic" in captured.err
    text = (workplace / "mine.toml").read_text()
    assert "# mean of: seven synthetic arrays" in text
    assert load("planar-sim", ["@mine.toml"]).electrode.modal_matrix != load("planar-sim").electrode.modal_matrix


def test_shape_from_calibrated_arrays(capsys):
    assert main(["calibrate", "array", str(EXAMPLE), "--to", "known.toml"]) == Exit.OK
    arguments = ["--known", "known.toml", "--known", "known.toml", "--to", "mine.toml"]
    assert main(["calibrate", "shape", "--point", "16.774", "3.437", *arguments]) == Exit.OK
    estimated, known = (
        np.array(tomllib.loads(Path(name).read_text())["electrode"]["modal_matrix"])
        for name in ("mine.toml", "known.toml")
    )
    assert estimated[:, 1:] == pytest.approx(known[:, 1:])
    assert "synthetic" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [("[stylet]\nspeed_mm_per_s = 4.0\n", "no electrode.modal_matrix"), ("[electrode", "not valid TOML"),
     ("[electrode]\nmodal_matrix = [[1, 2], [3, 4]]\n", "electrode.modal_matrix must be a list of 4"), (None, "cannot be read")],
)  # fmt: skip
def test_a_known_array_that_is_none_is_refused(workplace, capsys, text, message):
    if text is not None:
        (workplace / "known.toml").write_text(text)
    assert main(["calibrate", "shape", "--point", "16", "3", "--known", "known.toml"]) == Exit.BAD_INPUT
    assert message in capsys.readouterr().err


def test_a_point_out_of_reach_is_refused(capsys):
    assert main(["calibrate", "shape", "--point", "-30", "3"]) == Exit.FAILED
    assert "does not reach the measured point" in capsys.readouterr().err
