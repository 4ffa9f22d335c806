"""The measurement behind (III.61): many poses, each approached so that every leg has taken up its backlash.

D drives through 300 poses and notes from which side each leg came. Here every leg turns by far more than a backlash between
two poses and does not turn round on the way, so no pose lies between the two planes.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.stats import qmc

from rtctl.calibrate.errors import CalibrationError
from rtctl.calibrate.simulated import SimulatedRobot
from rtctl.calibrate.tracked_poses import TrackedPoses
from rtctl.robots import Robot
from rtctl.workflow import Progress

POSES = 300
TURN_MIN_RAD = 10.0
"""Least turn of every motor between two poses: some five times a backlash."""
ROOM_MM = 0.5
"""Distance of every piston from its ends."""
CANDIDATES = 60
WAY_POINTS = 20
STEADY = 0.1
"""No motor gets slower than this share of its mean on the way, so that none turns round between two points."""
SETTLE_S = 0.3
STEP = "poses"


def poses_to_track(robot: Robot, count: int = POSES) -> np.ndarray:
    """Poses (count, dof) all over the workspace, in an order in which every leg moves one way, and far, between two.

    Raises:
        CalibrationError: there are not so many.
    """
    low, high = robot.record["box_low"][0], robot.record["box_high"][0]
    pool = list(low + qmc.Halton(robot.dof, scramble=False).random(CANDIDATES * count) * (high - low))
    chosen = [robot.home_pose]
    pool = [pose for pose in pool if _has_room(robot, pose)]
    while len(chosen) <= count:
        at = next((k for k, pose in enumerate(pool) if _goes_one_way(robot, chosen[-1], pose)), None)
        if at is None:
            raise CalibrationError("there are not so many poses with long ways between them", value=count, bound=f"{len(chosen) - 1} in this workspace", remedy="ask for fewer poses")  # fmt: skip
        chosen.append(pool.pop(at))
    return np.array(chosen[1:])


def track(
    simulated: SimulatedRobot,
    poses: np.ndarray,
    report: Callable[[Progress], None] = lambda _: None,
    noise: tuple[float, float] = (0.0, 0.0),
    seed: int = 0,
) -> TrackedPoses:
    """Home the simulated robot, go to `poses` (n, dof), and note what a tracker sees and the motors count.

    Args:
        noise: standard deviations of the tracker, lengths [mm] and angles [rad].
        seed: of that noise.

    Raises:
        WorkflowError: a motion did not come to its end.
    """
    robot, settings = simulated.robot, simulated.settings
    rng = np.random.default_rng(seed)
    deviation = np.repeat(noise, (robot.length_dofs, robot.dof - robot.length_dofs))
    done = 0

    def whole(progress: Progress) -> None:
        share = (done + progress.fraction) / len(poses)
        report(replace(progress, fraction=share) if progress.name == STEP else progress)

    script = simulated.script((STEP,), whole)
    home_rad = np.array(script.record["axis_angle_rad"][: robot.dof])
    seen, motor = [], []
    for done, pose in enumerate(poses):  # noqa: B007 - `whole` looks at it
        script.move(STEP, pose, settings)
        script.rest(STEP, SETTLE_S)
        motor.append(script.record["axis_angle_rad"][: robot.dof] - home_rad)
        seen.append(simulated.true_pose() + rng.normal(0.0, 1.0, robot.dof) * deviation)
    wanted = np.array([robot.inverse(pose)[1] for pose in (robot.home_pose, *poses)])
    return TrackedPoses(np.array(seen), np.array(motor), np.diff(wanted, axis=0) > 0.0)


def _has_room(robot: Robot, pose: np.ndarray) -> bool:
    if robot.explain(pose) is not None:
        return False
    joint, _ = robot.inverse(pose)
    low, high = np.maximum(robot.record["joint_low"][0], 0.0), robot.record["joint_high"][0]
    return bool((joint >= low + ROOM_MM).all() and (joint <= high - ROOM_MM).all())


def _goes_one_way(robot: Robot, start: np.ndarray, end: np.ndarray) -> bool:
    """On the straight way every motor turns in one direction, by TURN_MIN_RAD at least, and the robot may go there."""
    turned = robot.inverse(end)[1] - robot.inverse(start)[1]
    if np.abs(turned).min() < TURN_MIN_RAD:
        return False
    way = start + np.linspace(0.0, 1.0, WAY_POINTS)[:, None] * (end - start)
    if any(robot.explain(pose) is not None for pose in way[1:]):
        return False
    steps = np.diff([robot.inverse(pose)[1] for pose in way], axis=0)
    return bool((steps * np.sign(turned) >= STEADY * np.abs(turned) / len(steps)).all())
