"""The plan the tick will follow: placed at the entry, reachable, sane; and errors that say what to do."""

import dataclasses

import numpy as np
import pytest

from rtctl import planner, robots
from rtctl.electrode.path_validation import validate_path
from rtctl.planner import PlanError, make_plan
from rtctl.settings import from_table

SETTINGS = from_table({"trajectory": {"speed_rad_per_s": 0.5}})
ROBOT = robots.load(SETTINGS.robot.kind, SETTINGS.robot.geometry)
ENTRY = np.array(SETTINGS.workflow.entry_pose_mm_rad)


@pytest.fixture(scope="module")
def path():
    return make_plan(SETTINGS, ROBOT, ENTRY, 5)


def test_the_plan_is_valid_and_carries_its_number(path):
    validate_path(path, ROBOT.dof)
    assert path[0]["number"] == 5
    assert path[0]["entry_in_base"][:2] == pytest.approx(ENTRY[:2])


def test_the_same_entry_gives_the_same_bytes(path):
    assert make_plan(SETTINGS, ROBOT, ENTRY, 5).tobytes() == path.tobytes()


def test_the_plan_begins_an_array_length_before_the_entry_and_turns_with_it(path):
    depth, values, _ = planner.sample(path)
    assert depth[0] == 0.0
    assert np.diff(depth).max() <= planner.SAMPLE_MM + 1e-9
    start = values[0, :2] - ENTRY[:2]
    assert np.hypot(*start) == pytest.approx(SETTINGS.electrode.length_mm, abs=0.1)

    turned = ENTRY + np.array([1.0, 0.5, 0.015])
    _, moved, _ = planner.sample(make_plan(SETTINGS, ROBOT, turned, 6))
    c, s = np.cos(0.015), np.sin(0.015)
    expected = turned[:2] + (values[:, :2] - ENTRY[:2]) @ np.array([[c, s], [-s, c]])
    np.testing.assert_allclose(moved[:, :2], expected, atol=1e-9)
    np.testing.assert_allclose(moved[:, 2], values[:, 2] + 0.015, atol=1e-9)
    np.testing.assert_allclose(moved[:, 3], values[:, 3], atol=1e-9)


@pytest.mark.parametrize("entry", [[np.nan] * 3, [170.0, 2.0], [170.0, 2.0, np.inf]])
def test_no_entry_no_plan(entry):
    with pytest.raises(PlanError, match="not registered"):
        make_plan(SETTINGS, ROBOT, entry, 1)


def test_an_entry_out_of_reach_is_refused_with_depth_and_bound():
    with pytest.raises(PlanError, match=r"at depth .* mm the robot cannot follow") as error:
        make_plan(SETTINGS, ROBOT, ENTRY + np.array([60.0, 0.0, 0.0]), 1)
    assert error.value.bound
    assert error.value.remedy


def test_a_path_too_fast_for_the_limits_is_refused_with_the_speed_that_is_not(path):
    slow = dataclasses.replace(SETTINGS, stylet=dataclasses.replace(SETTINGS.stylet, speed_mm_per_s=1.0))
    with pytest.raises(PlanError, match="stylet would be too fast") as error:
        planner.check_speed(slow, ROBOT, path)
    _, _, slopes = planner.sample(path)
    assert error.value.value == pytest.approx(SETTINGS.workflow.speed_mm_per_s * slopes[:, 3].max(), abs=1e-3)
    speed = float(error.value.remedy.split()[-3])
    workflow = dataclasses.replace(slow.workflow, speed_mm_per_s=speed)
    planner.check_speed(dataclasses.replace(slow, workflow=workflow), ROBOT, path)


def test_the_progress_may_cancel():
    def cancel(done, total):
        if done == 3:
            raise KeyboardInterrupt
        assert done < 3 < total

    with pytest.raises(KeyboardInterrupt):
        make_plan(SETTINGS, ROBOT, ENTRY, 1, cancel)
