"""A plan as a file comes back as it went in, says what it is for, and is refused for everything else."""

import json
from datetime import UTC, datetime

import numpy as np
import pytest

from hal.errors import OptionError, RtctlError
from rtctl import plan_file, planner, robots
from rtctl.electrode.robot_path import robot_path
from rtctl.electrode.synthetic_arrays import modal_matrix
from rtctl.planner import PlanError, make_plan, plan_of
from rtctl.settings import from_table, load

SETTINGS = load("planar-sim")
ROBOT = robots.load(SETTINGS.robot.kind, SETTINGS.robot.geometry)
ENTRY = np.array(SETTINGS.workflow.entry_pose_mm_rad)
NOON = datetime(2026, 3, 1, 12, tzinfo=UTC)


@pytest.fixture(scope="module")
def plan():
    return plan_of(SETTINGS)


@pytest.fixture(scope="module")
def file(plan):
    return plan_file.describe(SETTINGS, plan, ENTRY, NOON)


@pytest.fixture
def content(file):
    return json.loads(json.dumps(plan_file.document(file)))


def test_a_file_reads_back_to_the_same_plan_and_the_same_path(file, plan, tmp_path):
    path = tmp_path / "plan.json"
    plan_file.save(file, path)
    again = plan_file.load(path)
    assert again == file
    assert again.made == "2026-03-01T12:00:00+00:00"
    known = plan_file.known_plan(SETTINGS, again)
    made, loaded = (make_plan(SETTINGS, ROBOT, ENTRY, 3, known=p) for p in (plan, known))
    assert made.tobytes() == loaded.tobytes()


def test_a_file_is_json_with_a_line_a_depth(file, tmp_path):
    plan_file.save(file, tmp_path / "plan.json")
    text = (tmp_path / "plan.json").read_text()
    assert text.startswith('{\n  "format": "rtctl insertion plan",\n  "version": 1,')
    rows = json.loads(text)["depths"]["pose_in_cochlea_mm_rad"]
    assert all(json.dumps(row) in text for row in rows)


def test_a_plan_may_be_carried_out_at_another_entry_than_it_was_checked_at(file):
    known, moved = plan_file.known_plan(SETTINGS, file), ENTRY + np.array([-0.4, -0.3, 0.02])
    path = make_plan(SETTINGS, ROBOT, moved, 1, known=known)
    assert path.tobytes() == make_plan(SETTINGS, ROBOT, moved, 1).tobytes()


def test_a_small_cochlea_makes_a_short_file(tmp_path):
    settings = load("planar-sim", ["cochlea.spiral_a_mm=3.3", "workflow.depth_mm=12.0", "workflow.speed_mm_per_s=0.5"])
    small = plan_of(settings)
    plan_file.save(plan_file.describe(settings, small, ENTRY), tmp_path / "small.json")
    again = plan_file.known_plan(settings, plan_file.load(tmp_path / "small.json"))
    assert again.depth_mm[-1] == small.depth_mm[-1] == 13.0
    with pytest.raises(PlanError, match=r"another cochlea: got 3\.3"):
        make_plan(SETTINGS, ROBOT, ENTRY, 1, known=again)


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("electrode.modal_matrix=[[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,0]]", "another array.*row 0, column 0"),
        ("cochlea.spiral_a_mm=4.0", r"another cochlea: got 3.84 \(allowed: cochlea.spiral_a_mm = 4.0\)"),
        ("cochlea.side=left", "another cochlea: got 'right'"),
        ("robot.geometry.a_mm=[63.2,63.2,64.01]", "another robot"),
        ("robot.geometry.box_high_mm_rad=[175.0,8.0,0.32]", "another robot"),
    ],
)
def test_a_plan_for_something_else_is_refused(file, assignment, message):
    settings = load("planar-sim", [assignment])
    robot = robots.load(settings.robot.kind, settings.robot.geometry)
    with pytest.raises(PlanError, match=message) as error:
        make_plan(settings, robot, ENTRY, 1, known=plan_file.known_plan(settings, file))
    assert "rtctl plan make" in error.value.remedy


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("workflow.speed_mm_per_s=2.9", "too fast"),
        ("stylet.speed_mm_per_s=1.0", "stylet would be too fast"),
        ("stylet.stroke_mm=12.0", r"stylet beyond its stroke: got 12.* \(allowed: at most stylet.stroke_mm = 12 mm"),
        ("cochlea.recess_angle_rad=0.2", r"too far beside the registered direction: got -?0.\d+ .*recess_angle_rad"),
        ("cochlea.recess_clearance_mm=1.0", "the array passes the facial recess too far"),
    ],
)
def test_a_plan_beyond_a_bound_is_refused_with_value_bound_and_remedy(file, assignment, message):
    settings = load("planar-sim", [assignment])
    with pytest.raises(PlanError, match=message) as error:
        make_plan(settings, ROBOT, ENTRY, 1, known=plan_file.known_plan(settings, file))
    assert error.value.value is not None
    assert error.value.bound
    assert error.value.remedy


def test_a_plan_outside_the_workspace_is_refused(file):
    with pytest.raises(PlanError, match=r"at depth .* mm the robot cannot follow"):
        make_plan(SETTINGS, ROBOT, ENTRY + np.array([3.0, 2.0, 0.0]), 1, known=plan_file.known_plan(SETTINGS, file))


def test_a_workflow_deeper_than_the_plan_is_refused_with_the_depth_there_is():
    settings = load("planar-sim", ["cochlea.spiral_a_mm=3.3"])
    with pytest.raises(PlanError, match="at most 13 mm") as error:
        make_plan(settings, ROBOT, ENTRY, 1)
    assert error.value.remedy == "set workflow.depth_mm to 13 or less"


def test_the_window_of_the_planning_is_the_recess_of_the_patient():
    settings = load("planar-sim", ["cochlea.recess_angle_rad=0.2"])
    turned = plan_of(settings).pose_in_cochlea[:, 2] - np.radians(146.342)
    assert np.abs(turned).max() == pytest.approx(0.2, abs=1e-9)
    make_plan(settings, ROBOT, ENTRY, 1)


def change(content, path, value):
    *keys, last = path
    for key in keys:
        content = content[key]
    if value is None:
        del content[last]
    else:
        content[last] = value


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("format",), "log", "not an insertion plan: got 'log'"),
        (("format",), None, "not an insertion plan"),
        (("version",), 2, r"version this program does not know: got 2 \(allowed: 1\)"),
        (("version",), None, "version"),
        (("made",), None, "plan.made is missing"),
        (("extra",), 1, "unknown key plan.extra"),
        (("robot", "kind"), 3, "plan.robot.kind must be a str"),
        (("electrode", "modal_matrix", 2, 1), float("nan"), r"plan.electrode.modal_matrix\[2\]\[1\] must be a finite"),
        (("electrode", "modal_matrix", 3), [0, 0, 0], r"modal_matrix\[3\] must be a list of 4"),
        (("cochlea", "spiral_a_mm"), 9.0, "plan.cochlea.spiral_a_mm is out of bounds: got 9.0"),
        (("cochlea", "side"), "middle", "plan.cochlea.side is out of bounds"),
        (("depths", "stylet_mm", 5), float("inf"), r"plan.depths.stylet_mm\[5\] must be a finite number"),
        (("depths", "stylet_mm", 5), "1", r"stylet_mm\[5\] must be a float"),
        (("depths", "pose_in_cochlea_mm_rad", 7), [1.0, 2.0], r"pose_in_cochlea_mm_rad\[7\] must be a list of 3"),
        (("depths", "stylet_mm"), [0.0] * 30, r"stylet_mm has another length than depth_mm: got 30 \(allowed: 31\)"),
        (("depths", "depth_mm"), [0.0, 0.5], "another length"),
        (("depths", "depth_mm", 4), 2.25, r"depth 4 is off the grid: got 2.25 \(allowed: 2 mm\)"),
        (("depths", "stylet_mm", 28), 0.0, "stylet back in at depth 14 mm"),
        (("depths", "pose_in_cochlea_mm_rad", 9), [16.0, -7.6, 2.4], "cost at depth 4.5 mm is not that of the pose"),
        (("depths", "cost_mm2", 30), 0.0, "cost at depth 15 mm"),
        (("cochlea", "spiral_a_mm"), 3.9, "cost at depth"),
        (("electrode", "modal_matrix", 0, 0), 0.01, "cost at depth"),
    ],
)
def test_an_edited_or_damaged_file_is_refused(content, path, value, message):
    change(content, path, value)
    with pytest.raises((PlanError, OptionError), match=message) as error:
        plan_file.known_plan(SETTINGS, plan_file.from_document(content))
    assert error.value.exit_code == 2


@pytest.mark.parametrize("content", [None, [], "plan", 3])
def test_what_is_no_table_is_no_plan(content):
    with pytest.raises(PlanError, match="not an insertion plan"):
        plan_file.from_document(content)


@pytest.mark.parametrize("data", [b"", b"{", b"\xff\xfe", b"[" * 100_000])
def test_a_file_that_is_no_json_is_told(tmp_path, data):
    path = tmp_path / "plan.json"
    path.write_bytes(data)
    with pytest.raises(RtctlError, match="is not JSON"):
        plan_file.load(path)


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(RtctlError, match="cannot be read"):
        plan_file.load(tmp_path / "no.json")


def test_fingerprint_is_that_of_the_values_not_of_what_was_written():
    written = robots.fingerprint("planar_3rpr", {"a_mm": [63.2, 63.2, 64.0]})
    assert written == robots.fingerprint("planar_3rpr", {})
    assert written != robots.fingerprint("planar_3rpr", {"a_mm": [63.2, 63.2, 64.1]})


@pytest.mark.parametrize("number", range(1, 8))
def test_plans_of_all_synthetic_arrays_pass_the_recess_they_were_made_for(number):
    settings = from_table({"electrode": {"modal_matrix": modal_matrix(number).tolist()}})
    planner.check_recess(settings, robot_path(plan_of(settings), ENTRY, 1), ENTRY)
