"""The scripted insertion (I section II-C): one script for the daemon's client and for lockstep.

The surgeon points the empty gripper at the entry, it is registered and the gripper drawn back; an array is loaded, the
force sensor unbiased and the array's tip brought back to the entry; the path is planned and carried out.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from hal.errors import RtctlError
from rtctl.commands import Verb
from rtctl.electrode.array_shape import tip
from rtctl.guidance.impedance.layout import READY
from rtctl.lifecycle import Condition, Operating, Task
from rtctl.robots import Robot
from rtctl.settings import Settings

STANDOFF_MM = 1.0
"""The array's tip is brought this near to the entry before there is a plan; the approach goes the rest of the way."""
SLACK_S = 10.0
"""Time a step may take beyond what its motion needs."""

Predicate = Callable[[Any], bool]


@dataclass(frozen=True)
class Cause:
    """A condition in the operator's words."""

    text: str
    remedy: str


class Operator(Protocol):
    """Whoever gives the commands and sees the records: a client of the daemon, or a script in lockstep."""

    def command(self, verb: Verb, *arguments: float) -> int:
        """Give one command and return the tick at which it took effect.

        Raises:
            RtctlError: the controller refuses it.
        """

    def wait(self, until: Predicate, timeout_s: float) -> Any:
        """Let time pass until `until` holds for a record or `timeout_s` are over; the newest record either way."""

    def plan(self, progress: Callable[[float], None]) -> int:
        """Compute the plan from the registered entry and load it; the tick at which it took effect.

        Raises:
            RtctlError: there is no plan from there.
        """

    def causes(self, record: Any) -> list[Cause]:
        """The conditions that hold in `record`, or ended its motion, with the numbers they arose with."""


@dataclass(frozen=True)
class Progress:
    """Where the script is: step `index` of `count`, `fraction` of it done, and what is measured."""

    index: int
    count: int
    name: str
    fraction: float
    time_s: float
    depth_mm: float
    force_n: float
    """resistance along the insertion axis, NaN before the sensor is unbiased"""


class WorkflowError(RtctlError):
    """A step did not come to its end.

    Attributes:
        step: name of the step.
        causes: conditions that hold or ended the motion.
        record: the newest controller record, None before the first.
    """

    exit_code = 1

    def __init__(self, step: str, reason: str, remedy: str, causes: list[Cause], record: Any) -> None:
        self.step, self.causes, self.record = step, causes, record
        texts = "; ".join(cause.text for cause in causes)
        remedies = "; ".join(dict.fromkeys(cause.remedy for cause in causes))
        super().__init__(f"{step}: {reason}{f': {texts}' if texts else ''}", remedy=remedies or remedy)
        if record is not None and record["operating_state"] == Operating.FAULT:
            self.exit_code = 5


STEPS = (
    "enable",
    "home",
    "move to the entry",
    "register the entry",
    "retract",
    "load the array",
    "unbias the sensor",
    "return to the entry",
    "plan",
    "approach",
    "insert",
    "hold",
    "stop",
)
"""Names of the steps of :func:`insert_array`, in order."""


def insert_array(
    operator: Operator, settings: Settings, robot: Robot, report: Callable[[Progress], None] = lambda _: None
) -> Any:
    """Carry out the whole work-flow of `settings.workflow`; the record at its end.

    Raises:
        WorkflowError: a step ended in another way than it should, or took too long.
        RtctlError: a command was refused, or there is no plan.
    """
    flow = settings.workflow
    entry, aside = np.array(flow.entry_pose_mm_rad), np.array(flow.retracted_pose_mm_rad)
    back = pose_before_entry(settings, robot, entry)
    script = Script(operator, report, STEPS)

    script.enable_and_home(settings)
    script.move("move to the entry", entry, settings)
    script.do("register the entry", Verb.REGISTER_ENTRY, until=lambda r: np.isfinite(r["pose_entry"]).all())
    script.move("retract", aside, settings)
    script.do("load the array", Verb.LOAD_ARRAY, until=lambda r: r["array_loaded"])
    script.do("unbias the sensor", Verb.UNBIAS, until=lambda r: r["is_unbiased"], timeout_s=settings.wrench.unbias_s + SLACK_S)  # fmt: skip
    script.move("return to the entry", back, settings)
    script.plan()
    script.approach()
    guided = settings.impedance.guidance and settings.impedance.mode == "stepwise"
    script.insert(flow.depth_mm, flow.speed_mm_per_s, settings.impedance.interval_mm if guided else math.inf)
    script.rest("hold", flow.hold_s)
    return script.do("stop", Verb.STOP, until=lambda r: r["task_state"] == Task.DONE)


def pose_before_entry(settings: Settings, robot: Robot, entry: np.ndarray) -> np.ndarray:
    """Gripper pose (dof,) in {B} that puts the tip of a straight array short of the entry, oriented as registered.

    entry: pose (dof,) in {B} of the empty gripper when it pointed at the entry.
    """
    x, y = tip(np.array(settings.electrode.modal_matrix), 0.0)
    reach = robot.rotation(entry) @ np.array([x + STANDOFF_MM, y, 0.0])
    pose = entry.copy()
    pose[: sum(robot.translation_mask)] -= reach[np.array(robot.translation_mask)]
    return pose


class Script:
    """Runs step after step and tells where it is.

    Args:
        operator: who gives the commands.
        report: is told the progress.
        steps: names of the steps, in order.
    """

    def __init__(self, operator: Operator, report: Callable[[Progress], None], steps: tuple[str, ...]) -> None:
        self.operator, self.report, self.steps = operator, report, steps
        self.step = ""
        self.start_ns = -1
        self.record: Any = None

    def do(
        self,
        name: str,
        verb: Verb,
        *arguments: float,
        until: Predicate,
        timeout_s: float = SLACK_S,
        share: Callable[[Any], float] = lambda _: 0.0,
    ) -> Any:
        """Give the command of a step and wait for its end; `share` tells how much of it is done."""
        self.step = name
        self._tell(0.0)
        return self._wait(self.operator.command(verb, *arguments), until, timeout_s, share)

    def enable_and_home(self, settings: Settings) -> Any:
        """The steps "enable" and "home"."""
        timeout_s = settings.homing.timeout_s + SLACK_S
        self.do("enable", Verb.ENABLE, until=lambda r: r["powered"])
        return self.do("home", Verb.HOME, until=lambda r: r["is_homed"] and not r["is_busy"], timeout_s=timeout_s)

    def move(self, name: str, goal: np.ndarray, settings: Settings) -> Any:
        """Straight to the pose `goal`, for as long as the slowest coordinate needs."""
        limits = settings.trajectory
        way = np.abs(goal - self.record["pose_measured"])
        seconds = 2 * (float(way.max()) / limits.speed_mm_per_s + float(way[-1]) / limits.speed_rad_per_s)
        total = max(float(np.linalg.norm(way)), 1e-9)

        def arrived(r: Any) -> bool:
            return not r["is_busy"] and np.allclose(r["pose_desired"], goal, rtol=0.0, atol=1e-6)

        def done(r: Any) -> float:
            return 1.0 - float(np.linalg.norm(goal - r["pose_measured"])) / total

        return self.do(name, Verb.MOVE_CP, *map(float, goal), until=arrived, timeout_s=seconds + SLACK_S, share=done)

    def plan(self) -> Any:
        """The step "plan": have it computed and loaded."""
        self.step = "plan"
        self._tell(0.0)
        tick = self.operator.plan(self._tell)
        return self._wait(tick, lambda r: r["plan_number"] > 0, SLACK_S, lambda _: 0.0)

    def approach(self) -> Any:
        """The step "approach": to the first pose of the plan."""
        at_entry = Task.AT_ENTRY
        return self.do("approach", Verb.APPROACH, until=lambda r: r["task_state"] == at_entry, timeout_s=3 * SLACK_S)

    def insert(self, depth_mm: float, speed_mm_per_s: float, interval_mm: float = math.inf) -> Any:
        """The step "insert": along the plan to a depth.

        interval_mm: rest at every multiple of it, and at the end, until the stylet has been corrected by impedance.
        """
        guided = math.isfinite(interval_mm)
        for k in range(1, math.ceil(depth_mm / interval_mm - 1e-9) if guided else 1):
            self._insert_to(k * interval_mm, depth_mm, speed_mm_per_s, guided)
        return self._insert_to(depth_mm, depth_mm, speed_mm_per_s, guided)

    def _insert_to(self, stop_mm: float, depth_mm: float, speed_mm_per_s: float, until_ready: bool) -> Any:
        def arrived(r: Any) -> bool:
            there = r["task_state"] == Task.HOLDING and r["depth_mm"] >= stop_mm - 1e-6
            return there and (not until_ready or r["impedance_phase"] == READY)

        return self.do(
            "insert",
            Verb.INSERT,
            stop_mm,
            speed_mm_per_s,
            until=arrived,
            timeout_s=2 * stop_mm / max(speed_mm_per_s, 1e-3) + SLACK_S,
            share=lambda r: float(r["depth_mm"]) / max(depth_mm, 1e-9),
        )

    def rest(self, name: str, duration_s: float) -> None:
        """Do nothing for a while."""
        self.step = name
        start_ns, tick = int(self.record["time_ns"]), int(self.record["tick"])

        def share(r: Any) -> float:
            return (int(r["time_ns"]) - start_ns) * 1e-9 / max(duration_s, 1e-9)

        self._wait(tick, lambda r: share(r) >= 1.0, duration_s + SLACK_S, share)

    def _wait(self, tick: int, until: Predicate, timeout_s: float, share: Callable[[Any], float]) -> Any:
        def over(r: Any) -> bool:
            self._see(r)
            self._tell(share(r))
            return r["tick"] >= tick and (until(r) or _is_off(r) or _has_stopped(r, tick))

        record = self.operator.wait(over, timeout_s)
        self._see(record)
        if record is not None and record["tick"] >= tick and until(record) and not _is_off(record):
            self._tell(1.0)
            return record
        raise self._failure(record, tick, timeout_s)

    def _failure(self, record: Any, tick: int, timeout_s: float) -> WorkflowError:
        if record is None:
            reason, causes = "no record arrived", []
        else:
            state = Operating(int(record["operating_state"])).name
            causes = self.operator.causes(record)
            reason = f"not finished after {timeout_s:.0f} s"
            if _is_off(record):
                reason = f"the controller is {state}"
            elif _has_stopped(record, tick):
                reason = "the motion was stopped"
        return WorkflowError(self.step, reason, "look at `rtctl status` and at the report of the run", causes, record)

    def _see(self, record: Any) -> None:
        if record is not None:
            self.record = record
            if self.start_ns < 0:
                self.start_ns = int(record["time_ns"])

    def _tell(self, fraction: float) -> None:
        r = self.record
        self.report(
            Progress(
                index=self.steps.index(self.step),
                count=len(self.steps),
                name=self.step,
                fraction=min(max(fraction, 0.0), 1.0) if math.isfinite(fraction) else 0.0,
                time_s=0.0 if r is None else (int(r["time_ns"]) - self.start_ns) * 1e-9,
                depth_mm=0.0 if r is None else float(r["depth_mm"]),
                force_n=math.nan if r is None else -float(r["force_axial_n"]),
            )
        )


def _is_off(record: Any) -> bool:
    """Neither enabled nor about to be: nothing will move any more."""
    return record["operating_state"] != Operating.ENABLED


def _has_stopped(record: Any, tick: int) -> bool:
    """A condition, or somebody, has ended the motion that began in `tick`."""
    return record["tick"] > tick and not record["is_busy"] and record["stop_cause"] >= 0


def conditions_of(record: Any) -> list[Condition]:
    """The conditions that hold in a record, the fault's cause and the one that ended the last motion, none twice."""
    active = int(record["condition_active"])
    found = [c for c in Condition if active >> c & 1]
    for name in ("fault_cause", "stop_cause"):
        number = int(record[name])
        if number >= 0 and (name == "stop_cause" or record["operating_state"] == Operating.FAULT):
            found.append(Condition(number))
    return list(dict.fromkeys(found))
