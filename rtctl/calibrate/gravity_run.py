"""Turn the robot where it stands, read the force sensor at rest, and fit what it carries (05 section 1; D III.7)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from hal.frames import VALID
from rtctl import robots
from rtctl.calibrate.errors import CalibrationError
from rtctl.calibrate.gravity import ForceFit, MomentFit, fit_forces, fit_moments, fit_sphere
from rtctl.lifecycle import Operating
from rtctl.robots import Robot
from rtctl.settings import Settings
from rtctl.workflow import SLACK_S, Operator, Progress, Script

BOUND_N = 0.03
"""Largest force that may be left on a pose the fit has not seen (05 section 1)."""
POSES = 12
SAMPLES = 50
"""Readings whose mean is taken at every pose, as they come: 50 a second from the daemon, 10 in lockstep."""
SAMPLE_S = 0.2
SETTLE_S = 0.5
TURN_MIN_RAD = 0.3
"""The robot has to be able to turn so far where it stands, about 17 degrees."""
CANDIDATES = 64
SENSOR_AXES = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
"""{F} in the gripper, row by row: x_F is the gripper's z, y_F its -y, z_F its x (rtctl/wrench.py)."""

METHODS: dict[str, Callable[[np.ndarray, np.ndarray, float], ForceFit]] = {
    "linear": lambda turns, force, _noise: fit_forces(turns, force),
    "sphere": fit_sphere,
}


@dataclass(frozen=True)
class Readings:
    """Mean raw wrenches (n, 6) in {F} at rest, the rotations (n, 3, 3) from {B} into {F}, and the noise (6,) of a mean."""

    turns: np.ndarray
    wrench_in_sensor: np.ndarray
    noise: np.ndarray


@dataclass(frozen=True)
class Gravity:
    """What the sensor carries, and what is left (n,) at every pose when the fit is made without it."""

    force: ForceFit
    moment: MomentFit
    left_n: np.ndarray
    left_nmm: np.ndarray

    @property
    def bias_in_sensor(self) -> np.ndarray:
        """Bias (6,) [N, N mm] in {F}."""
        return np.concatenate((self.force.bias_in_sensor_n, self.moment.bias_in_sensor_nmm))

    def not_told(self) -> list[str]:
        """What the orientations did not tell, in words."""
        return [
            f"{what} along {_axis(v[:3], v)} of {{{frame}}} cannot be told from {bias} along {_axis(-v[3:], v)} of {{F}}"
            for what, frame, bias, free in (
                ("gravity", "B", "bias", self.force.free),
                ("the centre of mass", "F", "moment bias", self.moment.free),
            )
            for v in free
        ]


def fit(readings: Readings, method: str = "linear") -> Gravity:
    """Force fit by `method`, one of METHODS, then the moment fit, both also without each pose in turn.

    Raises:
        CalibrationError: the readings do not determine it.
    """
    turns, wrench = readings.turns, readings.wrench_in_sensor
    noise_n = float(readings.noise[:3].max())

    def both(kept: np.ndarray) -> tuple[ForceFit, MomentFit]:
        force = METHODS[method](turns[kept], wrench[kept, :3], noise_n)
        return force, fit_moments(turns[kept] @ force.gravity_force_in_base_n, wrench[kept, 3:])

    left = np.empty((len(turns), 6))
    for k in range(len(turns)):
        force, moment = both(np.arange(len(turns)) != k)
        weight = turns[k : k + 1] @ force.gravity_force_in_base_n
        left[k, :3] = wrench[k, :3] - force.predict(turns[k : k + 1])[0]
        left[k, 3:] = wrench[k, 3:] - moment.predict(weight)[0]
    force, moment = both(np.ones(len(turns), dtype=bool))
    return Gravity(force, moment, np.linalg.norm(left[:, :3], axis=1), np.linalg.norm(left[:, 3:], axis=1))


def require(gravity: Gravity, bound_n: float = BOUND_N) -> None:
    """Raise CalibrationError if more than `bound_n` is left at a pose the fit has not seen."""
    worst = int(np.argmax(gravity.left_n))
    if not gravity.left_n[worst] <= bound_n:
        raise CalibrationError(
            f"too much force is left at pose {worst + 1}, which the fit had not seen",
            value=round(float(gravity.left_n[worst]), 4),
            bound=f"{bound_n:g} N",
            remedy="see that nothing touches the module, no cable pulls and the sensor is warm; or allow it with --bound",
        )


def run(
    operator: Operator,
    settings: Settings,
    count: int = POSES,
    report: Callable[[Progress], None] = lambda _: None,
    samples: int = SAMPLES,
) -> Readings:
    """Turn to `count` orientations where the robot stands, read the sensor at rest at each, and turn back.

    Raises:
        CalibrationError: the robot is not ready, cannot turn enough here, or a reading was not valid or did not come.
        WorkflowError: a motion did not come to its end.
    """
    robot = robots.load(settings.robot.kind, settings.robot.geometry)
    record = operator.wait(lambda r: r is not None, SLACK_S)
    if record is None:
        raise CalibrationError("no record arrived", remedy="look at `rtctl status`")
    check_ready(record)
    start = np.array(record["pose_measured"])
    poses = poses_about(robot, start, count)
    names = tuple(f"pose {k + 1}" for k in range(count))
    script = Script(operator, report, (*names, "return"))
    script.record, script.start_ns = record, int(record["time_ns"])
    turns, means, variances = [], [], []
    for name, pose in zip(names, poses, strict=True):
        script.move(name, pose, settings)
        script.rest(name, SETTLE_S)
        at_rest = Rest(samples)
        operator.wait(at_rest, samples * SAMPLE_S + SLACK_S)
        measured, wrench = at_rest.result()
        turns.append(turn_into_sensor(robot, measured.mean(axis=0)))
        means.append(wrench.mean(axis=0))
        variances.append(wrench.var(axis=0, ddof=1))
    script.move("return", start, settings)
    noise = np.sqrt(np.mean(variances, axis=0) / samples)
    return Readings(np.array(turns), np.array(means), noise)


def turn_into_sensor(robot: Robot, pose: np.ndarray) -> np.ndarray:
    """^F R_B (3, 3) at a pose (dof,)."""
    return SENSOR_AXES @ robot.rotation(pose).T


def poses_about(robot: Robot, pose: np.ndarray, count: int = POSES) -> np.ndarray:
    """Poses (count, dof) that turn the gripper where it stands, spread evenly over what the robot can do.

    Raises:
        CalibrationError: it cannot turn enough there.
    """
    low, high = (robot.record[f"box_{side}"][0][robot.length_dofs :] for side in ("low", "high"))
    spread = qmc.Halton(len(low), scramble=False).random(CANDIDATES * count)
    candidates = np.tile(pose, (len(spread), 1))
    candidates[:, robot.length_dofs :] = low + spread * (high - low)
    able = np.array([robot.explain(p) is None for p in candidates])
    poses = candidates[able]
    if len(poses) > count:  # evenly over the whole of the room, which may be a small part of the box
        poses = poses[np.linspace(0, len(poses) - 1, count).round().astype(int)]
    rotations = Rotation.from_matrix([robot.rotation(p) for p in poses]) if len(poses) else None
    turn = 0.0 if rotations is None else max(float((rotations * r.inv()).magnitude().max()) for r in rotations)
    if len(poses) < count or turn < TURN_MIN_RAD:
        raise CalibrationError(
            "the robot cannot turn enough where it stands",
            value=f"{turn:.2f} rad at {np.round(pose, 3).tolist()}",
            bound=f"at least {TURN_MIN_RAD:g} rad",
            remedy="move the gripper to the middle of the workspace, clear of everything, with `rtctl move`",
        )
    return poses


def check_ready(record: Any) -> None:
    """Raise CalibrationError unless the robot may move, stands still, has nothing in the gripper, and the sensor works."""
    state = Operating(int(record["operating_state"]))
    for bad, what, value, remedy in (
        (
            state != Operating.ENABLED,
            "the robot is not enabled",
            state.name,
            "look at `rtctl status`, then `rtctl enable`",
        ),
        (not record["is_homed"], "the robot is not homed", None, "run `rtctl home`"),
        (record["array_loaded"], "an array is loaded, and would be weighed too", None, "run `rtctl unload-array`"),
        (record["is_busy"], "another motion or routine is under way", None, "wait for it, or run `rtctl stop`"),
        (not _usable(record), "the force sensor gives no valid reading", None, "look at `rtctl status`"),
    ):
        if bad:
            raise CalibrationError(what, value=value, remedy=remedy)


class Rest:
    """Collects fresh readings while the robot stands still; a predicate for :meth:`rtctl.workflow.Operator.wait`."""

    def __init__(self, count: int) -> None:
        self._count, self._sequence = count, -1
        self._poses: list[np.ndarray] = []
        self._wrenches: list[np.ndarray] = []
        self._problem: CalibrationError | None = None

    def __call__(self, record: Any) -> bool:
        """Look at a record; True when there is nothing more to wait for."""
        if self._problem is None and record is not None and record["wrench_sequence"] != self._sequence:
            try:
                check_ready(record)
            except CalibrationError as problem:
                self._problem = problem
            self._sequence = int(record["wrench_sequence"])
            self._poses.append(np.array(record["pose_measured"]))
            self._wrenches.append(np.array(record["wrench_in_sensor"]))
        return self._problem is not None or len(self._wrenches) >= self._count

    def result(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, dof) and raw wrenches (n, 6). Raises CalibrationError if they are not all there."""
        if self._problem is not None:
            raise self._problem
        if len(self._wrenches) < self._count:
            raise CalibrationError(
                "the force sensor has stopped", value=f"{len(self._wrenches)} readings", bound=f"{self._count}"
            )
        return np.array(self._poses), np.array(self._wrenches)


def _usable(record: Any) -> bool:
    return record["wrench_validity"] == VALID and bool(np.isfinite(record["wrench_in_sensor"]).all())


def _axis(part: np.ndarray, whole: np.ndarray) -> str:
    """A direction as text; the sign is that which makes the first large entry of the whole positive."""
    sign = np.sign(whole[np.argmax(np.abs(whole) > 0.5 * np.abs(whole).max())])
    length = max(float(np.linalg.norm(part)), 1e-12)
    return "(" + ", ".join(f"{v + 0.0:.3g}" for v in np.round(sign * part / length, 3)) + ")"
