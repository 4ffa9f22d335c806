"""The figures of a run: `summary.json` of a run's folder and the answer of ``rtctl sim --json``."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rtctl import robots
from rtctl.gateway.events import remedy_of, say
from rtctl.lifecycle import TABLE, Condition, Motion, Operating
from rtctl.recording import Recording

INSERTION_SHARE = 0.95
"""Forces count over this first part of the inserted depth, as in I section VI: the rest is gripper against bone."""
STYLET_STARTS_MM = 0.1
"""Planned withdrawal from which the stylet counts as moving (post-AOS): plans creep by less long before."""
DEPTH_TOLERANCE_MM = 0.01


@dataclass(frozen=True)
class Figure:
    """One key of the summary. A figure that is not known is null."""

    name: str
    unit: str
    meaning: str
    compute: Callable[["Run"], Any]


class Run:
    """A recording with what several figures need, computed once.

    wall_s: wall time of the loop, known for a lockstep run that has just been made.
    """

    def __init__(self, recording: Recording, wall_s: float | None = None) -> None:
        self.recording, self.wall_s = recording, wall_s
        self.records = recording.records
        self.inserting = self.records[recording.insertion]
        depth = self.inserting["depth_mm"]
        self.depth_mm = float(depth.max()) if len(depth) else 0.0
        self.goal_mm = float(self.inserting["depth_goal_mm"][-1]) if len(depth) else math.nan
        self.measured = self.inserting[depth <= INSERTION_SHARE * self.depth_mm]
        started = np.flatnonzero(self.inserting["stylet_desired_mm"] >= STYLET_STARTS_MM)
        self.aos_depth_mm = float(depth[started[0]]) if len(started) else math.nan
        self.period_s = recording.settings.loop.period_s
        robot = recording.settings.robot
        self.lengths = robots.load(robot.kind, robot.geometry).length_dofs

    def outcome(self) -> str:
        """One word for the whole run."""
        states = self.records["operating_state"]
        if (states == Operating.FAULT).any():
            return "fault"
        awake = states[states != Operating.DISABLED]
        if len(awake) and awake[-1] == Operating.PAUSED:
            return "paused"
        if not len(self.inserting):
            return "not inserted"
        return "completed" if self.depth_mm >= self.goal_mm - DEPTH_TOLERANCE_MM else "incomplete"

    def axial(self, post_aos: bool = False) -> np.ndarray:
        """Resistance (k,) [N], positive against the insertion, over the part of the insertion that counts."""
        rows = self.measured
        if post_aos:
            rows = rows[rows["depth_mm"] >= self.aos_depth_mm]
        return _finite(-rows["force_axial_n"])

    def tip_error(self) -> float:
        """Distance of the measured gripper tip from the reference, rms over the insertion [mm]."""
        return _path_error(self.inserting["pose_measured"], self.inserting["pose_reference"], self.lengths)

    def true_tip_error(self) -> float:
        """The same with the plant's true gripper tip."""
        pair = self.recording.paired
        if pair is None or "pose_gripper_in_base" not in (pair[1].dtype.names or ()):
            return math.nan
        inserting = np.isin(pair[0]["tick"], self.inserting["tick"])
        return _path_error(
            pair[1]["pose_gripper_in_base"][inserting], pair[0]["pose_reference"][inserting], self.lengths
        )

    def work_nmm(self) -> float:
        """Work of the resistance over the part of the insertion that counts."""
        rows = self.measured[np.isfinite(self.measured["force_axial_n"])]
        return float(np.trapezoid(-rows["force_axial_n"], rows["depth_mm"])) if len(rows) > 1 else math.nan

    def truth(self, name: str) -> np.ndarray | None:
        """What is true of `name` during the insertion (k, ...); None where nobody knows."""
        pair = self.recording.paired
        if pair is None or name not in (pair[1].dtype.names or ()):
            return None
        return pair[1][name][np.isin(pair[0]["tick"], self.inserting["tick"])]

    def became(self, name: str) -> bool | None:
        """Whether a true event has happened by the end of the insertion; None where nobody knows."""
        values = self.truth(name)
        return None if values is None or not len(values) else bool(values[-1])

    def true_peak(self, name: str) -> float:
        """Largest true value during the insertion."""
        values = self.truth(name)
        return math.nan if values is None else _largest(values)

    def timing_us(self, name: str, percentile: float) -> float:
        """Percentile of a measured time [µs] over the ticks with power; NaN in lockstep, where nothing is measured."""
        times = self.records[name]
        return float(np.percentile(times, percentile)) * 1e-3 if times.any() else math.nan

    def real_time_factor(self) -> float:
        """Time of the loop over time on the wall."""
        if self.wall_s is not None:
            return len(self.records) * self.period_s / self.wall_s
        if not self.records["tick_ns"].any():
            return math.nan
        missed = int(self.records["missed_ticks"][1:].sum())
        return len(self.records) / (len(self.records) + missed)

    def cause(self, number: int) -> dict[str, Any] | None:
        """A condition in words, with the numbers it first arose with as a cause; None for none."""
        if number < 0 or number not in Condition._value2member_map_:
            return None
        condition = Condition(number)
        arose = np.flatnonzero(self.records["condition_reported"] == number)
        value = bound = math.nan
        if len(arose):
            row = self.records[arose[-1]]
            value, bound = float(row["condition_value"]), float(row["condition_bound"])
        active = np.flatnonzero(self.records["condition_active"] >> number & 1)
        return {
            "name": condition.name.lower(),
            "reaction": TABLE[condition].reaction.name.lower(),
            "tick": int(self.records["tick"][active[0]]) if len(active) else None,
            "text": say(condition, value, bound),
            "remedy": remedy_of(condition, value),
        }

    def fault(self) -> dict[str, Any] | None:
        """The first condition that led to a fault."""
        causes = self.records["fault_cause"]
        return self.cause(int(causes[causes >= 0][0])) if (causes >= 0).any() else None

    def stop(self) -> dict[str, Any] | None:
        """The condition that ended the last motion along the path."""
        on_path = np.flatnonzero(np.isin(self.records["motion"], (Motion.INSERT, Motion.RETRACT)))
        if not len(on_path) or on_path[-1] + 1 >= len(self.records):
            return None
        return self.cause(int(self.records["stop_cause"][on_path[-1] + 1]))


FIGURES = (
    Figure("outcome", "", "completed (the insertion reached its depth, no fault), fault, paused, incomplete or not inserted", Run.outcome),
    Figure("depth_mm", "mm", "deepest commanded insertion depth", lambda r: r.depth_mm),
    Figure("depth_goal_mm", "mm", "depth the last insertion was to reach", lambda r: r.goal_mm),
    Figure("duration_s", "s", "from the first to the last record", lambda r: float(r.recording.time_s[-1])),
    Figure("insertion_s", "s", "time in task state inserting", lambda r: len(r.inserting) * r.period_s),
    Figure("insertion_force_mean_n", "N", "mean resistance, -force_axial_n, over the first 95 % of the inserted depth", lambda r: _mean(r.axial())),
    Figure("insertion_force_peak_n", "N", "largest resistance over the same part", lambda r: _largest(r.axial())),
    Figure("post_aos_force_mean_n", "N", "mean resistance over the same part from aos_depth_mm on", lambda r: _mean(r.axial(post_aos=True))),
    Figure("aos_depth_mm", "mm", "depth at which the plan begins to withdraw the stylet (0.1 mm)", lambda r: r.aos_depth_mm),
    Figure("lateral_force_mean_n", "N", "mean force_lateral_n over the first 95 % of the inserted depth", lambda r: _mean(_finite(r.measured["force_lateral_n"]))),
    Figure("lateral_correction_mm", "mm", "largest path correction by the lateral admittance law", lambda r: _largest(np.linalg.norm(r.inserting["admittance_offset_mm"], axis=1))),
    Figure("insertion_work_nmm", "N mm", "work of the resistance over the same part", lambda r: r.work_nmm()),
    Figure("array_folded", "", "the array's tip is folded over at the end of the insertion, truth; simulation only", lambda r: r.became("folded")),
    Figure("array_buckled", "", "the array stays bent by more than 10 degrees outside the entry, truth; simulation only", lambda r: r.became("buckled")),
    Figure("array_depth_mm", "mm", "largest true length of array beyond the entry; simulation only", lambda r: r.true_peak("array_depth_mm")),
    Figure("lateral_wall_peak_n", "N", "largest true sum of the lateral wall's normal forces; simulation only", lambda r: r.true_peak("lateral_wall_n")),
    Figure("stylet_mm", "mm", "measured stylet withdrawal at the end of the insertion", lambda r: float(r.inserting["stylet_measured_mm"][-1]) if len(r.inserting) else math.nan),
    Figure("tip_path_error_rms_mm", "mm", "gripper tip, measured against reference, over the insertion", Run.tip_error),
    Figure("true_tip_error_rms_mm", "mm", "gripper tip, true against reference, over the insertion; simulation only", Run.true_tip_error),
    Figure("ticks", "", "ticks recorded", lambda r: len(r.records)),
    Figure("overruns", "", "times the loop missed its next grid point", lambda r: int((r.records["missed_ticks"][1:] > 0).sum())),
    Figure("missed_ticks", "", "grid points skipped because of them", lambda r: int(r.records["missed_ticks"][1:].sum())),
    Figure("lost_records", "", "ticks that ran and are not in the log", lambda r: r.recording.lost_records),
    Figure("log_complete", "", "the log was closed and all of it is readable", lambda r: r.recording.complete),
    Figure("tick_us_p50", "µs", "time of a tick, median; null in lockstep", lambda r: r.timing_us("tick_ns", 50)),
    Figure("tick_us_p999", "µs", "the same, 99.9th percentile", lambda r: r.timing_us("tick_ns", 99.9)),
    Figure("lateness_us_p50", "µs", "wake-up after the grid point, median; null in lockstep", lambda r: r.timing_us("lateness_ns", 50)),
    Figure("lateness_us_p99", "µs", "the same, 99th percentile", lambda r: r.timing_us("lateness_ns", 99)),
    Figure("real_time_factor", "", "lockstep: simulated time over the wall time of the loop, null from a log; else ticks run over grid points", Run.real_time_factor),
    Figure("grade", "", "what the real-time process obtained: rt, best-effort or sim", lambda r: r.recording.header.get("grade")),
    Figure("config_hash", "", "of all settings", lambda r: r.recording.header.get("config_hash")),
    Figure("kernel_hash", "", "of the sources of all kernels", lambda r: r.recording.header.get("kernel_hash")),
    Figure("seed", "", "of the simulation's noise", lambda r: _integer(r.recording.header.get("seed"))),
    Figure("fault_cause", "", "condition that led to the fault: name, reaction, tick, text, remedy", Run.fault),
    Figure("stop_cause", "", "condition that ended the last motion along the path, likewise", Run.stop),
)  # fmt: skip
"""Every key of the summary, in order: name, unit, definition."""


def summarise(recording: Recording, wall_s: float | None = None) -> dict[str, Any]:
    """All figures of a run by name, plain values; `wall_s` is the wall time of the loop of a lockstep run."""
    run = Run(recording, wall_s)
    return {figure.name: _plain(figure.compute(run)) for figure in FIGURES}


def write(summary: dict[str, Any], directory: Path) -> Path:
    """Put `summary.json` into `directory`."""
    path = directory / "summary.json"
    path.write_text(json.dumps(summary, indent=2, ensure_ascii=False) + "\n")
    return path


def _path_error(pose: np.ndarray, reference: np.ndarray, lengths: int) -> float:
    squares = ((pose - reference)[:, :lengths] ** 2).sum(axis=1)
    return math.sqrt(_mean(_finite(squares)))


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else math.nan


def _largest(values: np.ndarray) -> float:
    return float(values.max()) if len(values) else math.nan


def _integer(text: str | None) -> int | None:
    return None if text is None else int(text)


def _plain(value: Any) -> Any:
    """JSON has no NaN; six significant digits are more than any figure is good for."""
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value
