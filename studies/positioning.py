"""Accuracy and repeatability of the whole position loop on the plant, measured as in D III.8 (Table III.6).

    python -m studies.positioning           prints the table, a minute

The robot is started and homed anew for every trial, from another pose. In a trial the gripper goes to and fro along each
coordinate of the pose by itself, through the workspace box W (01 section 1.2), and rests at points on the way; every point
is so approached from either side. Accuracy is the rms distance of the true pose from the desired one, repeatability that from
the mean of all visits of a point. Poses are the plant's truth: the tracker the source measured with is not in them.

Before calibration the controller believes the drawings and compensates no backlash. For the calibration the robot drives
through 300 poses that a tracker sees with noise, as `rtctl calibrate record` and `rtctl calibrate backlash` do it.
"""

import argparse
import math
import sys
from collections.abc import Iterable

import numpy as np

from rtctl.calibrate.simulated import SimulatedRobot
from rtctl.calibrate.transmission import fit_legs
from rtctl.calibrate.transmission_run import POSES, poses_to_track, track
from rtctl.robots import Robot
from rtctl.settings import Settings, load

TRIALS = 10
POINTS = 9
SETTLE_S = 0.3
BOX = np.array([[155.0, -4.0, math.radians(-6.0)], [170.0, 4.0, math.radians(17.0)]])
"""W of 01 section 1.2: smallest and largest x, y, phi."""
TRACKER = (0.03, 5e-4)
"""Noise of the tracker in the calibration [mm], [rad], about that of q and psi in 05 section 4."""
AS_DRAWN = ("control.backlash_rad=[0.0, 0.0, 0.0, 0.0]",)
START_SCATTER = np.array([2.0, 2.0, 0.02])
"""Half width of where the robot stands when it is switched on, about the plant's default [mm, mm, rad]."""
START = np.array([154.0, -5.0, -0.01])
PRINTED = {"repeatability": (0.02, 0.13, 0.04), "accuracy": (0.1, 0.8, 0.25)}
"""Table III.6 [mm, mm, deg]; its x row does not fit the model (01 section 1.5)."""


def calibrated(overrides: Iterable[str] = AS_DRAWN, seed: int = 100, poses: int = POSES) -> tuple[str, ...]:
    """The overrides, and on top of them what a calibration of the wire drives finds."""
    settings = load("planar-sim", overrides)
    simulated = SimulatedRobot(settings, seed)
    robot = simulated.robot
    tracked = track(simulated, poses_to_track(robot, poses), noise=TRACKER, seed=seed)
    legs = fit_legs(robot, tracked.pose, tracked.motor_rad, tracked.extending)
    simulated.close()
    stylet = settings.control.backlash_rad[robot.dof :]
    return (
        *overrides,
        f"control.backlash_rad={[*(leg.backlash_rad for leg in legs), *stylet]}",
        f"robot.geometry.eta_mm_per_rad={[leg.eta_mm_per_rad for leg in legs]}",
        f"robot.geometry.pulley_radius_mm={[leg.pulley_radius_mm for leg in legs]}",
    )


def cycle(points: int = POINTS) -> np.ndarray:
    """Desired poses (3, 2, points, 3): along x, y and phi through the middle of the box, up and then down again."""
    poses = np.tile(BOX.mean(axis=0), (3, 2, points, 1))
    for k in range(3):
        poses[k, 0, :, k] = np.linspace(BOX[0, k], BOX[1, k], points)
        poses[k, 1, :, k] = poses[k, 0, ::-1, k]
    return poses


def visit(settings: Settings, seed: int, poses: np.ndarray) -> np.ndarray:
    """True poses, shaped like `poses`, of one trial: power up, home, and rest at every pose in order."""
    simulated = SimulatedRobot(settings, seed)
    script = simulated.script(("cycle",))
    script.move("cycle", BOX.mean(axis=0), settings)
    true = np.empty_like(poses)
    for at in np.ndindex(poses.shape[:-1]):
        script.move("cycle", poses[at], settings)
        script.rest("cycle", SETTLE_S)
        true[at] = simulated.true_pose()
    simulated.close()
    return true


def trials(overrides: Iterable[str], count: int = TRIALS, points: int = POINTS) -> tuple[np.ndarray, np.ndarray]:
    """Desired poses (3, 2, points, 3), and true ones (count, 3, 2, points, 3) of trials with seeds from 0 on."""
    poses = cycle(points)
    visits = []
    for seed in range(count):
        start = START + START_SCATTER * np.random.default_rng(seed).uniform(-1.0, 1.0, 3)
        settings = load("planar-sim", (*overrides, f"backend.options.start_pose_mm_rad={start.tolist()}"))
        visits.append(visit(settings, seed, poses))
    return poses, np.array(visits)


def accuracy(desired: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Rms (3,) [mm, mm, rad] of the true poses from the desired ones."""
    return _rms(true - desired)


def repeatability(true: np.ndarray, either_side: bool = True) -> np.ndarray:
    """Rms (3,) [mm, mm, rad] of true poses from their mean at each point, over all visits or over those from one side."""
    visits = np.stack((true[:, :, 0], true[:, :, 1, ::-1]), axis=2)  # the way down has the points in the other order
    return _rms(visits - visits.mean(axis=(0, 2) if either_side else 0, keepdims=True))


def joint_noise(robot: Robot, error_rad: float, draws: int = 20000, seed: int = 0) -> np.ndarray:
    """Rms (3,) [mm, mm, rad] of the pose over W if every motor angle is off by so much rms, independently (05 section 5)."""
    grid = np.stack(
        np.meshgrid(*(np.linspace(BOX[0, k], BOX[1, k], n) for k, n in enumerate((7, 5, 9)))), axis=-1
    ).reshape(-1, 3)
    rng = np.random.default_rng(seed)
    off = np.empty((draws, 3))
    for k in range(draws):
        pose = grid[rng.integers(len(grid))]
        off[k] = robot.forward(robot.inverse(pose)[1] + rng.normal(0.0, error_rad, 3)) - pose
    return _rms(off)


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(np.square(values), axis=tuple(range(values.ndim - 1))))


def _row(name: str, values: Iterable[float]) -> str:
    x, y, phi = values
    return f"| {name} | {x:.3f} | {y:.3f} | {phi:.3f} |"


def _in_degrees(values: np.ndarray) -> np.ndarray:
    return values * (1.0, 1.0, math.degrees(1.0))


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.positioning", description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=TRIALS, help="how often the robot is started anew")
    count = parser.parse_args().trials
    print("| rms | x [mm] | y [mm] | phi [deg] |\n| --- | --- | --- | --- |")
    for what, overrides in (("as drawn", AS_DRAWN), ("calibrated", calibrated())):
        desired, true = trials(overrides, count)
        print(_row(f"accuracy, {what}", _in_degrees(accuracy(desired, true))))
        print(_row(f"repeatability from either side, {what}", _in_degrees(repeatability(true))))
        print(_row(f"repeatability from one side, {what}", _in_degrees(repeatability(true, either_side=False))))
    for name, values in PRINTED.items():
        print(_row(f"{name}, Table III.6", values))
    return 0


if __name__ == "__main__":
    sys.exit(main())
