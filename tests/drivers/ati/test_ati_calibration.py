"""Calibration files of both generations, against matrices computed another way, and everything that must be refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drivers.ati import calibration
from drivers.ati.mounting import frame_change
from hal.errors import OptionError

HERE = Path(__file__).parent
EXAMPLE = HERE.parents[2] / "config" / "example-sensor.cal"
NEWER, OLDER = (HERE / "newer.cal").read_text(), (HERE / "older.cal").read_text()


def parse(text, part=""):
    return calibration.parse(text.encode(), part, "file.cal")


def seen_from(wrench, origin, angles_rad):
    """The wrench of point forces, computed point by point in the moved frame."""
    axes = Rotation.from_euler("XYZ", angles_rad).inv()
    force, torque = wrench[:3], wrench[3:]
    # a pair of opposite forces makes the torque, one force at the old origin makes the rest
    arm = np.cross(torque, [0.31, -0.52, 0.79])
    push = np.cross(torque, arm) / max(arm @ arm, 1e-30)
    points = [(np.zeros(3), force), (arm, push), (np.zeros(3), -push)]
    moved = [(axes.apply(p - origin), axes.apply(f)) for p, f in points]
    return np.concatenate([sum(f for _, f in moved), sum(np.cross(p, f) for p, f in moved)])


@given(
    st.lists(st.floats(-50, 50), min_size=6, max_size=6),
    st.lists(st.floats(-100, 100), min_size=3, max_size=3),
    st.lists(st.floats(-7, 7), min_size=3, max_size=3),
)
def test_frame_change_is_what_forces_at_points_do(wrench, origin, angles_rad):
    wrench, origin = np.array(wrench), np.array(origin)
    expected = seen_from(wrench, origin, angles_rad)
    assert frame_change(origin, angles_rad) @ wrench == pytest.approx(expected, abs=1e-6, rel=1e-9)


def test_newer_file_uses_the_user_axes_as_they_are():
    c = parse(NEWER)
    assert c.matrix[0] == pytest.approx([0.5460629, 1.6841063, 0.9681989, -3.4288777, 0.4880365, 1.9967084], rel=0)
    assert c.matrix[5, 3] == 35.3723706
    assert c.rated.tolist() == [18.0] * 3 + [250.0] * 3
    assert (c.serial, c.body, c.part, c.date) == ("FT00002", "Nano43", "SI-18-0.25", "1/1/2026")
    assert c.thermistor_v is None


def test_both_generations_of_one_file_give_the_same_matrix():
    only_axis = "\n".join(line for line in NEWER.splitlines() if "UserAxis" not in line)
    assert parse(only_axis).matrix == pytest.approx(parse(NEWER).matrix, rel=1e-5, abs=1e-5)
    only_user = "\n".join(line for line in NEWER.splitlines() if "<Axis" not in line)
    assert (parse(only_user).matrix == parse(NEWER).matrix).all()
    assert (parse(only_user).rated == parse(NEWER).rated).all()


def test_older_file_in_n_and_nm_comes_out_in_n_and_nmm_with_its_lever_in_metres():
    """One gauge column by hand: values / scale, moved by (1.5, -2, 4.3) mm and turned by 30 degrees about z."""
    c = parse(OLDER)
    column = np.array(
        [-7054.15712 / 2500, -4701.41612 / 2500, -25.80601 / 1250, -267.79 / 80, 17.61 / 80, 2001.64 / 100]
    )
    assert c.matrix[:, 3] == pytest.approx(seen_from(column, np.array([1.5, -2.0, 4.3]), [0, 0, np.radians(30)]))
    assert c.rated == pytest.approx([18.0] * 3 + [250.0] * 3)
    assert c.thermistor_v == 2.4310
    assert c.gain_slope[3] == 0.022


def test_pounds_and_inches_are_the_manufacturers():
    text = NEWER.replace(
        'ForceUnits="N" TorqueUnits="N-mm" DistUnits="mm"', 'ForceUnits="lb" TorqueUnits="lb-in" DistUnits="in"'
    )
    text = "\n".join(line for line in text.splitlines() if "<Axis" not in line)
    c, metric = parse(text), parse(NEWER)
    assert c.matrix[:3] == pytest.approx(4.44822161526 * metric.matrix[:3])
    assert c.matrix[3:] == pytest.approx(112.984829028 * metric.matrix[3:])


def test_the_shipped_example_is_read():
    c = calibration.load(EXAMPLE)
    assert "FT00001" in c.identity
    assert np.linalg.cond(c.matrix / c.rated[:, None]) < 15
    with pytest.raises(OptionError, match="cannot be read"):
        calibration.load(EXAMPLE.with_name("nowhere.cal"))


def test_one_of_several_calibrations_has_to_be_named():
    body = NEWER[NEWER.index("\t<Calibration") : NEWER.index("</FTSensor>")]
    two = NEWER.replace(
        "</FTSensor>", body.replace("SI-18-0.25", "SI-9-0.125").replace('max="18"', 'max="9"') + "</FTSensor>"
    )
    assert parse(two, "SI-9-0.125").rated[0] == 9.0
    for part in ("", "SI-36-0.5"):
        with pytest.raises(OptionError, match="set part"):
            parse(two, part)


BILLION = """<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>
<FTSensor Serial="&b;"/>"""
OUTSIDE = """<?xml version="1.0"?><!DOCTYPE x SYSTEM "file:///etc/hostname"><FTSensor/>"""


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("FTSensor", "Robot"), "root"),
        (('NumGages="6"', 'NumGages="8"'), "gauges"),
        ((' NumGages="6"', ""), "NumGages"),
        (('ForceUnits="N"', 'ForceUnits="dyn"'), "ForceUnits"),
        (('TorqueUnits="N-mm" ', ""), "TorqueUnits"),
        (('DistUnits="mm"', 'DistUnits="furlong"'), "DistUnits"),
        (('OutputRange="20"', 'OutputRange="10"'), "OutputRange"),
        (('GainMultiplier="1"', 'GainMultiplier="2"'), "GainMultiplier"),
        (('OutputBipolar="True"', 'OutputBipolar="False"'), "unipolar"),
        (("8.97281", ""), "count of Axis Fx"),
        (("8.97281", "8.97281 1.0"), "count"),
        (("8.97281", "nan"), "finite"),
        (("8.97281", "1e999"), "finite"),
        (("8.97281", "8,97281"), "finite"),
        (("8.97281", "8_9"), "finite"),
        (("8.97281", "٨"), "finite"),
        (("8.97281", "8.99281"), "different things"),
        (('scale="2.5"', 'scale="0"'), "positive"),
        (('max="18"', 'max="-18"'), "positive"),
        (('Name="Fx"', 'Name="Fy"'), "other elements"),
        (('Rx="10" ', ""), "Rx"),
        (("</FTSensor>", ""), "well-formed"),
        (('encoding="utf-8"', 'encoding="klingon"'), "well-formed|decoded"),
        (("<Calibration", "<Calibrations"), "well-formed"),
        ((NEWER, "<FTSensor Serial='1' NumGages='6'/>"), "several or no"),
        ((NEWER, BILLION), "document type"),
        ((NEWER, OUTSIDE), "document type"),
        ((NEWER, " " * 1_000_001), "too large"),
        ((NEWER, ""), "well-formed"),
    ],
)
def test_odd_files_are_refused_by_name_and_reason(change, says):
    with pytest.raises(OptionError, match=says) as caught:
        parse(NEWER.replace(*change))
    assert "file.cal" in str(caught.value)


def test_half_a_compensation_and_a_singular_matrix_are_refused():
    with pytest.raises(OptionError, match="temperature compensation"):
        parse("\n".join(line for line in OLDER.splitlines() if "GainSlope" not in line))
    lines = OLDER.splitlines()
    lines[5] = lines[4].replace("Fx", "Fy")
    with pytest.raises(OptionError, match="singular"):
        parse("\n".join(lines))


@given(st.integers(0, len(NEWER) - 1), st.text(max_size=5), st.integers(0, 40))
@settings(max_examples=300, deadline=None)
def test_a_damaged_file_is_refused_or_still_a_sound_calibration(at, put, cut):
    try:
        c = parse(NEWER[:at] + put + NEWER[at + cut :])
    except OptionError:
        return
    assert np.isfinite(c.matrix).all()
    assert (c.rated > 0).all()
    assert np.linalg.cond(c.matrix / c.rated[:, None]) < 1e3
