"""Tracked poses of the plant, and the file between tracker and fit: the plant's own backlash has to come back."""

from itertools import pairwise

import numpy as np
import pytest

from rtctl import robots
from rtctl.calibrate import tracked_poses
from rtctl.calibrate.errors import CalibrationError, CalibrationFileError
from rtctl.calibrate.simulated import SimulatedRobot
from rtctl.calibrate.tracked_poses import TrackedPoses
from rtctl.calibrate.transmission import LegFit, fit_legs, require
from rtctl.calibrate.transmission_run import TURN_MIN_RAD, poses_to_track, track
from rtctl.settings import load

SETTINGS = load("planar-sim")
ROBOT = robots.load(SETTINGS.robot.kind, SETTINGS.robot.geometry)
TRUE_BACKLASH, TRUE_LEAD = (1.9, 2.4, 1.5), (0.09703, 0.09698, 0.09702)


@pytest.fixture(scope="module")
def tracked():
    return track(SimulatedRobot(SETTINGS, 0), poses_to_track(ROBOT, 24))


def test_every_leg_goes_far_and_one_way_between_two_poses():
    poses = np.vstack((ROBOT.home_pose, poses_to_track(ROBOT, 60)))
    for start, end in pairwise(poses):
        way = start + np.linspace(0.0, 1.0, 300)[:, None] * (end - start)
        motor = np.array([ROBOT.inverse(pose)[1] for pose in way])
        assert (np.abs(motor[-1] - motor[0]) >= TURN_MIN_RAD).all()
        steps = np.diff(motor, axis=0)
        assert ((steps > 0).all(axis=0) | (steps < 0).all(axis=0)).all()
        assert all(ROBOT.explain(pose) is None for pose in way[1:])


def test_more_poses_than_there_are_is_an_error(monkeypatch):
    monkeypatch.setattr("rtctl.calibrate.transmission_run.TURN_MIN_RAD", 400.0)
    with pytest.raises(CalibrationError, match=r"not so many poses.*5.*in this workspace"):
        poses_to_track(ROBOT, 5)


def test_the_backlash_of_the_plant_comes_back(tracked):
    """Its geometry is off by micrometres, so that leads come out to 1e-5 mm/rad; 1.8, 2.2 and 1.6 rad were believed."""
    legs = fit_legs(ROBOT, tracked.pose, tracked.motor_rad, tracked.extending)
    assert [leg.backlash_rad for leg in legs] == pytest.approx(TRUE_BACKLASH, abs=0.02)
    assert [leg.eta_mm_per_rad for leg in legs] == pytest.approx(TRUE_LEAD, abs=3e-5)
    assert [leg.pulley_radius_mm for leg in legs] == pytest.approx([2.0] * 3, abs=0.03)
    assert max(leg.residual_rad for leg in legs) < 0.02
    require(legs)


@pytest.mark.parametrize("believed", [(0.0, 0.0, 0.0), (4.0, 4.0, 4.0)])
def test_it_does_not_depend_on_what_the_controller_compensates(believed):
    settings = load("planar-sim", [f"control.backlash_rad={[*believed, 0.0]}"])
    seen = track(SimulatedRobot(settings, 1), poses_to_track(ROBOT, 16))
    legs = fit_legs(ROBOT, seen.pose, seen.motor_rad, seen.extending)
    assert [leg.backlash_rad for leg in legs] == pytest.approx(TRUE_BACKLASH, abs=0.03)


def test_a_tracker_with_noise_sees_the_same_poses_blurred(tracked):
    seen = track(SimulatedRobot(SETTINGS, 0), poses_to_track(ROBOT, 24), noise=(0.05, 1e-3), seed=4)
    assert seen.motor_rad == pytest.approx(tracked.motor_rad, abs=0.0)
    off = seen.pose - tracked.pose
    assert np.std(off[:, :2]) == pytest.approx(0.05, rel=0.4)
    assert np.std(off[:, 2]) == pytest.approx(1e-3, rel=0.5)


def leg(backlash=1.0, residual=0.1):
    return LegFit(0.097, 2.0, (backlash, 0.0), residual, 1e-5, 0.01, 0.05)


def test_a_bad_fit_and_swapped_directions_are_refused(tracked):
    require([leg(), leg(backlash=-0.1)])  # none, within three standard deviations
    for legs, message in (
        ([leg(), leg(residual=0.7)], r"leg 2 does not fit.*0\.70 rad.*0\.6 rad.*--bound"),
        ([leg(residual=np.nan)], "leg 1 does not fit"),
        (fit_legs(ROBOT, tracked.pose, tracked.motor_rad, ~tracked.extending), r"motor of leg 1 seems to lag.*-1\.9"),
    ):
        with pytest.raises(CalibrationError, match=message):
            require(legs)
    require([leg(residual=0.7)], bound_rad=1.0)


class TestFile:
    def test_what_is_written_is_read_back(self, tracked, tmp_path):
        file = tmp_path / "poses.csv"
        tracked_poses.write(file, ROBOT, tracked, ["tracker: none"])
        again = tracked_poses.read(file, ROBOT)
        assert again.pose == pytest.approx(tracked.pose, abs=1e-7)
        assert again.motor_rad == pytest.approx(tracked.motor_rad, abs=1e-7)
        assert (again.extending == tracked.extending).all()
        assert file.read_text().splitlines()[:2] == ["# tracker: none", ",".join(tracked_poses.columns(ROBOT))]

    def test_columns_may_come_in_any_order_with_comments_between(self, tmp_path):
        file = tmp_path / "poses.csv"
        names = tracked_poses.columns(ROBOT)
        file.write_text(", ".join(reversed(names)) + "\n# a pause\n\n0,1,0,3,2,1,0.3,0.2,0.1\n")
        read = tracked_poses.read(file, ROBOT)
        assert (read.pose.tolist(), read.motor_rad.tolist()) == ([[0.1, 0.2, 0.3]], [[1.0, 2.0, 3.0]])
        assert read.extending.tolist() == [[False, True, False]]

    HEADER = "x_mm,y_mm,phi_rad,motor1_rad,motor2_rad,motor3_rad,extending1,extending2,extending3\n"

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            ("", "empty.*columns are x_mm"),
            ("# only a comment\n", "empty"),
            ("x_mm,y_mm\n", "wrong columns.*phi_rad"),
            (HEADER.replace("phi_rad", "phi_deg"), "phi_deg"),
            (HEADER.replace("phi_rad", "y_mm"), "y_mm|phi_rad"),
            (HEADER + "1,2,3\n", "line 2 has another number of columns.*3.*9"),
            (HEADER + "# c\n1,2,x,1,2,3,0,0,0\n", "line 3: phi_rad is not a finite number.*'x'"),
            (HEADER + "1,2,nan,1,2,3,0,0,0\n", "line 2: phi_rad is not a finite number"),
            (HEADER + "1,2,3,1,2,3,0,0.5,0\n", "line 2: extending2 is neither 0 nor 1.*0.5"),
        ],
    )
    def test_a_bad_file_is_refused_with_the_line(self, tmp_path, content, message):
        file = tmp_path / "poses.csv"
        file.write_text(content)
        with pytest.raises(CalibrationFileError, match=message):
            tracked_poses.read(file, ROBOT)

    def test_a_file_that_is_none(self, tmp_path):
        with pytest.raises(CalibrationFileError, match="cannot be read"):
            tracked_poses.read(tmp_path / "no.csv", ROBOT)
        binary = tmp_path / "binary.csv"
        binary.write_bytes(b"\xff\xfe\x00")
        with pytest.raises(CalibrationFileError, match="cannot be read"):
            tracked_poses.read(binary, ROBOT)

    def test_measurements_are_not_overwritten(self, tmp_path):
        file = tmp_path / "poses.csv"
        none = TrackedPoses(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), dtype=bool))
        tracked_poses.write(file, ROBOT, none)
        with pytest.raises(CalibrationFileError, match="exists"):
            tracked_poses.write(file, ROBOT, none)
        with pytest.raises(CalibrationFileError, match="cannot be written"):
            tracked_poses.write(tmp_path / "nowhere" / "poses.csv", ROBOT, none)
