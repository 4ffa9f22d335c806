"""A detector's file: it comes back as it was, and what does not fit is refused with a reason."""

import json

import pytest

from hal.errors import OptionError
from hal.options import table_of
from rtctl.guidance import detector_file
from rtctl.guidance.dataset import synthesise
from rtctl.guidance.detector_file import DetectorError
from rtctl.settings import config_hash, from_table, load


def test_it_comes_back_as_it_was(detector, tmp_path):
    path = tmp_path / "detector.json"
    detector_file.write(detector, path)
    again = detector_file.load(path)
    profiles = synthesise(9, 5, 5).profiles
    assert (again.folding.decide(profiles) == detector.folding.decide(profiles)).all()
    assert (again.folding.bound == detector.folding.bound).all()
    assert (again.forces.mean == detector.forces.mean).all()
    assert (again.buckling.deviation == detector.buckling.deviation).all()
    assert again.provenance["counts"] == {"normal": 51, "fold": 56, "buckle": 0}
    assert {"data", "digest", "date", "revision", "forces"} <= set(again.provenance)


def spoilt(table, path, value):
    copy = json.loads(json.dumps(table))
    *way, last = path
    inner = copy
    for key in way:
        inner = inner[key]
    if value is None:
        del inner[last]
    else:
        inner[last] = value
    return copy


@pytest.mark.parametrize(
    ("path", "value", "reason"),
    [
        (["format"], "something else", "format"),
        (["version"], 2, "version"),
        (["kind"], "forest", "kind"),
        (["surprise"], 1, "unknown key surprise"),
        (["folding", "w"], None, "folding.w is missing"),
        (["folding", "w"], [1.0] * 74, "number of features in folding.w"),
        (["folding", "w", 3], float("nan"), "finite"),
        (["folding", "b"], float("inf"), "finite"),
        (["folding", "S", 0], 0.0, "out of bounds"),
        (["folding", "method"], 1, "number of features"),
        (["folding", "known"], list(range(8, 97)), "folding.known"),
        (["folding", "bound"], [1.0] * 44, "folding.bound"),
        (["grid", "samples"], 101, "grid.samples"),
        (["grid", "feature_every"], 2, "grid.feature_every"),
        (["grid", "full_depth_mm"], 15.0, "grid.full_depth_mm"),
        (["grid", "channels"], ["f_z", "f_yy", "f_xx"], "grid.channels"),
        (["forces", "length"], 0.3, "forces.length"),
        (["forces", "deviation"], [[0.0] * 11] * 3, "no deviation"),
        (["buckling", "mean", 0, 5], "much", "must be a float"),
    ],
)
def test_what_was_trained_on_something_else_is_refused(table, path, value, reason):
    with pytest.raises(DetectorError, match=reason):
        detector_file.from_table(spoilt(table, path, value))


@pytest.mark.parametrize(
    ("text", "reason"),
    [("", "not JSON"), ("[1, 2]", "no detector"), ('{"b": NaN', "not JSON"), ("[" * 100_000, "not JSON")],
)
def test_what_is_no_table_is_refused(tmp_path, text, reason):
    path = tmp_path / "detector.json"
    path.write_text(text)
    with pytest.raises(DetectorError, match=reason):
        detector_file.load(path)


def test_settings_name_it_hold_it_and_are_refused_with_a_bad_one(table, tmp_path):
    path = tmp_path / "detector.json"
    path.write_text(json.dumps(table))
    settings = load("planar-sim", [f"guidance.detector={path}", "guidance.tip_fold=pause"])
    path.unlink()
    again = from_table(table_of(settings))
    assert again == settings
    path.write_text(json.dumps(spoilt(table, ["folding", "b"], 1.0)))
    assert config_hash(load("planar-sim", [f"guidance.detector={path}", "guidance.tip_fold=pause"])) != config_hash(settings)  # fmt: skip
    path.write_text(json.dumps(spoilt(table, ["version"], 7)))
    with pytest.raises(DetectorError, match="version"):
        load("planar-sim", [f"guidance.detector={path}"])
    with pytest.raises(DetectorError, match="cannot be read"):
        load("planar-sim", ["guidance.detector=/nowhere/detector.json"])


@pytest.mark.parametrize(
    ("override", "reason"),
    [
        ("guidance.tip_fold=pause", "nothing to react to"),
        ("guidance.buckling=retract", "nothing to react to"),
        ("guidance.tip_fold=faint", "tip_fold"),
        ("guidance.margin=1.5", "margin"),
    ],
)
def test_reactions_need_a_detector_and_names_that_are_known(override, reason):
    with pytest.raises(OptionError, match=reason):
        load("planar-sim", [override])
