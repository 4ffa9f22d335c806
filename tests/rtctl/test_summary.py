"""Every figure of the summary against a run made up so that its value is known."""

import json
import math

import numpy as np
import pytest

from rtctl import summary
from rtctl.cli.exit_codes import Exit
from rtctl.cli.outcome import exit_code
from rtctl.lifecycle import Condition, Motion, Operating, Task
from rtctl.record import controller_table
from rtctl.recording import Recording
from rtctl.settings import load
from rtctl.summary import FIGURES, summarise

SETTINGS = load("planar-sim")
N, BEFORE, AFTER = 1000, 100, 200
ISSUE = [
    "outcome",
    "depth_mm",
    "duration_s",
    "insertion_force_mean_n",
    "insertion_force_peak_n",
    "post_aos_force_mean_n",
    "lateral_force_mean_n",
    "stylet_mm",
    "tip_path_error_rms_mm",
    "ticks",
    "overruns",
    "lost_records",
    "tick_us_p50",
    "tick_us_p999",
    "lateness_us_p50",
    "lateness_us_p99",
    "real_time_factor",
    "grade",
    "config_hash",
    "seed",
]


def made_up(depth_mm: float = 10.0, goal_mm: float = 10.0) -> np.ndarray:
    """A run: 100 ticks idle, 1000 ticks of insertion at constant speed, 200 ticks holding."""
    rows = np.zeros(BEFORE + N + AFTER, controller_table(3).dtype)
    rows["tick"] = np.arange(len(rows))
    rows["time_ns"] = rows["tick"] * 1_000_000
    rows["operating_state"] = Operating.ENABLED
    for name in ("fault_cause", "stop_cause", "condition_reported"):
        rows[name] = -1
    inside = slice(BEFORE, BEFORE + N)
    rows["task_state"][inside], rows["task_state"][BEFORE + N :] = Task.INSERTING, Task.HOLDING
    rows["motion"][inside] = Motion.INSERT
    rows["depth_goal_mm"][BEFORE:] = goal_mm
    depth = depth_mm * np.arange(1, N + 1) / N
    rows["depth_mm"][inside], rows["depth_mm"][BEFORE + N :] = depth, depth_mm
    rows["force_axial_n"] = 9.0  # outside the insertion nothing counts
    rows["force_axial_n"][inside] = -0.01 * depth
    rows["force_lateral_n"][inside] = 0.02
    rows["stylet_desired_mm"][inside] = np.maximum(depth - 4.0, 0.0)
    rows["stylet_measured_mm"][inside] = np.maximum(depth - 4.0, 0.0)
    rows["pose_reference"][inside, 0] = depth
    rows["pose_measured"][inside, 0] = depth + 0.3
    rows["pose_measured"][inside, 1] = 0.4
    rows["pose_measured"][inside, 2] = 7.0  # an angle is no distance
    return rows


def recording(rows: np.ndarray, truths: np.ndarray | None = None, **changes) -> Recording:
    header = {"grade": "sim", "config_hash": "c", "kernel_hash": "k", "seed": "7"}
    return Recording(**{
        "settings": SETTINGS, "header": header, "records": rows, "truths": truths, "events": [], "plan": None,
        "lost_records": 0, "complete": True, **changes,
    })  # fmt: skip


def test_every_figure_of_the_agreed_list_is_there_and_defined():
    names = [figure.name for figure in FIGURES]
    assert len(set(names)) == len(names)
    assert set(ISSUE) <= set(names)
    assert all(figure.meaning for figure in FIGURES)


def test_forces_count_over_the_first_95_percent_of_the_depth():
    figures = summarise(recording(made_up()))
    assert figures["outcome"] == "completed"
    assert figures["depth_mm"] == 10.0
    assert figures["insertion_force_mean_n"] == pytest.approx(0.01 * 9.5 / 2, rel=2e-3)
    assert figures["insertion_force_peak_n"] == pytest.approx(0.095)
    assert figures["lateral_force_mean_n"] == pytest.approx(0.02)


def test_post_aos_begins_where_the_plan_withdraws_the_stylet():
    figures = summarise(recording(made_up()))
    assert figures["aos_depth_mm"] == pytest.approx(4.0 + summary.STYLET_STARTS_MM, abs=0.011)
    assert figures["post_aos_force_mean_n"] == pytest.approx(0.01 * (4.1 + 9.5) / 2, rel=2e-3)
    assert figures["stylet_mm"] == pytest.approx(6.0)


def test_tip_error_is_a_distance_and_the_true_one_needs_the_truth():
    rows = made_up()
    figures = summarise(recording(rows))
    assert figures["tip_path_error_rms_mm"] == pytest.approx(0.5)
    assert figures["true_tip_error_rms_mm"] is None
    truths = np.zeros(len(rows) - 50, [("time_ns", "u8"), ("tick", "i8"), ("pose_gripper_in_base", "f8", (3,))])
    truths["tick"] = rows["tick"][50:]
    truths["pose_gripper_in_base"] = rows["pose_reference"][50:] + np.array([0.0, -0.2, 1.0])
    assert summarise(recording(rows, truths))["true_tip_error_rms_mm"] == pytest.approx(0.2)
    anonymous = truths[["time_ns", "tick"]]
    assert summarise(recording(rows, anonymous))["true_tip_error_rms_mm"] is None


def test_times_are_those_of_the_run():
    figures = summarise(recording(made_up()), wall_s=0.013)
    assert figures["duration_s"] == pytest.approx(1.299)
    assert figures["insertion_s"] == pytest.approx(1.0)
    assert figures["ticks"] == 1300
    assert figures["real_time_factor"] == pytest.approx(100.0)


def test_lockstep_has_no_timing_and_a_real_run_has():
    rows = made_up()
    quiet = summarise(recording(rows))
    assert all(
        quiet[n] is None
        for n in ("tick_us_p50", "tick_us_p999", "lateness_us_p50", "lateness_us_p99", "real_time_factor")
    )
    rows["tick_ns"], rows["lateness_ns"] = 20_000, np.arange(len(rows)) * 100
    rows["missed_ticks"][[0, 300, 400]] = 5, 60, 40
    timed = summarise(recording(rows))
    assert timed["tick_us_p50"] == timed["tick_us_p999"] == pytest.approx(20.0)
    assert timed["lateness_us_p99"] == pytest.approx(0.1 * 0.99 * 1299)
    assert (timed["overruns"], timed["missed_ticks"]) == (2, 100), "what came before the first record is not of the run"
    assert timed["real_time_factor"] == pytest.approx(1300 / 1400)


def test_outcomes():
    assert summarise(recording(made_up(depth_mm=6.0)))["outcome"] == "incomplete"
    paused = made_up(depth_mm=6.0)
    paused["operating_state"][-100:] = Operating.PAUSED
    paused["operating_state"][-10:] = Operating.DISABLED
    assert summarise(recording(paused))["outcome"] == "paused"
    fault = made_up()
    fault["operating_state"][-50:-20] = Operating.FAULT
    assert summarise(recording(fault))["outcome"] == "fault", "also if it was acknowledged later"
    idle = made_up()[:BEFORE]
    figures = summarise(recording(idle))
    assert figures["outcome"] == "not inserted"
    assert figures["insertion_force_mean_n"] is None
    assert figures["stylet_mm"] is None


def test_causes_come_with_the_numbers_they_arose_with():
    rows = made_up(depth_mm=6.0)
    at = BEFORE + N
    rows["condition_active"][at] = 1 << Condition.FORCE_LIMIT
    rows["condition_reported"][at], rows["condition_value"][at], rows["condition_bound"][at] = (
        Condition.FORCE_LIMIT,
        0.62,
        0.5,
    )
    rows["stop_cause"][at:] = Condition.FORCE_LIMIT
    cause = summarise(recording(rows))["stop_cause"]
    assert (cause["name"], cause["reaction"], cause["tick"]) == ("force_limit", "pause", at)
    assert cause["text"] == "force 0.62 N exceeds 0.5 N"
    assert cause["remedy"]
    rows["fault_cause"][-1] = Condition.WATCHDOG
    assert summarise(recording(rows))["fault_cause"]["name"] == "watchdog"
    assert summarise(recording(made_up()))["stop_cause"] is None


def test_unknown_numbers_do_not_spoil_the_known_ones():
    rows = made_up()
    rows["force_axial_n"][BEFORE : BEFORE + 100] = math.nan
    figures = summarise(recording(rows))
    assert figures["insertion_force_mean_n"] == pytest.approx(0.01 * (1.0 + 9.5) / 2, rel=2e-3)


def test_file_is_plain_json(tmp_path):
    figures = summarise(recording(made_up()))
    path = summary.write(figures, tmp_path)
    assert json.loads(path.read_text()) == figures
    assert "NaN" not in path.read_text()


@pytest.mark.parametrize(
    ("changes", "good"),
    [({}, True), ({"lost_records": 1}, False), ({"complete": False}, False), ({"records": made_up(6.0)}, False)],
)
def test_good_is_complete_and_nothing_lost(changes, good):
    rows = changes.pop("records", made_up())
    assert (exit_code(summarise(recording(rows, **changes))) is Exit.OK) is good
