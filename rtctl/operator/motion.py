"""From the operator's twist to a rate of the pose: dead zone, speed stage, limits, and what the robot can do at all."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hal.errors import RtctlError
from rtctl import robots
from rtctl.operator.message import Frame
from rtctl.robots.orientation import per_euler_rates

STAGES = (0.1, 0.25, 0.5, 1.0)
"""Speed stages: the twist is multiplied by one of these."""


def _about_z(_pose: np.ndarray) -> np.ndarray:
    return np.array([[0.0], [0.0], [1.0]])


def _by_euler_angles(pose: np.ndarray) -> np.ndarray:
    return np.array([per_euler_rates(pose[4], pose[5], *row) for row in np.eye(3)])


def _by_slider_and_arc(pose: np.ndarray) -> np.ndarray:
    return np.array([[math.cos(pose[4]), 0.0], [math.sin(pose[4]), 0.0], [0.0, 1.0]])


TURNS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "planar_3rpr": _about_z,
    "cartesian_4": _about_z,
    "hexapod": _by_euler_angles,
    "cochlerob": _by_slider_and_arc,
}
"""Kind of robot -> the axes (3, n) in {B} about which it turns at a pose (dof,), one for each of its n angles."""


@dataclass(frozen=True)
class Limits:
    """What a bridge makes of a twist, after its speed stage.

    Attributes:
        speed_mm_per_s, speed_rad_per_s: longest linear and angular velocity; longer ones keep their direction.
        dead_mm_per_s, dead_rad_per_s: shorter ones than this, before the stage, are no wish at all.
    """

    speed_mm_per_s: float
    speed_rad_per_s: float
    dead_mm_per_s: float = 0.02
    dead_rad_per_s: float = 0.002


class Projection:
    """Carries a twist over to the degrees of freedom of a robot of kind `kind`.

    Raises:
        RtctlError: it is not known how this kind of robot follows a twist.
    """

    def __init__(self, kind: str, limits: Limits) -> None:
        if kind not in TURNS:
            remedy = "say in rtctl/operator/motion.py about which axes it turns"
            raise RtctlError(
                "a robot that cannot be driven by hand", value=kind, bound=" | ".join(TURNS), remedy=remedy
            )
        self._turns = TURNS[kind]
        self._limits = limits
        self._robot = robots.load(kind, {})  # how it turns with its pose is no matter of its geometry
        self._moves = np.array(self._robot.translation_mask)

    def rate(self, twist: np.ndarray, frame: Frame, pose: np.ndarray, stage: float) -> tuple[np.ndarray, bool]:
        """Rate of the pose (dof,) [mm/s, rad/s] in {B}, and whether something of the twist had to be dropped.

        Args:
            twist: (6,) [mm/s, rad/s] of the gripper's tip along the axes of `frame`.
            pose: (dof,) of the gripper in {B}; not finite where it is not known.
            stage: factor of :data:`STAGES`.
        """
        limits = self._limits
        v, w = twist[:3], twist[3:]
        if frame == "gripper":
            rotation = self._robot.rotation(pose)
            v, w = rotation @ v, rotation @ w
        v = stage * _live(v, limits.dead_mm_per_s)
        w = stage * _live(w, limits.dead_rad_per_s)
        axes = self._turns(pose)
        rates = np.linalg.solve(axes.T @ axes, axes.T @ w)  # of the turn it can do that is nearest to w
        turn = axes @ rates
        dropped = bool(
            (np.abs(v[~self._moves]) > stage * limits.dead_mm_per_s).any()
            or (np.abs(w - turn) > stage * limits.dead_rad_per_s).any()
        )
        v = _at_most(np.where(self._moves, v, 0.0), limits.speed_mm_per_s)
        slower = min(1.0, limits.speed_rad_per_s / max(float(np.linalg.norm(turn)), limits.speed_rad_per_s))
        return np.concatenate([v[self._moves], slower * rates]), dropped


def _live(vector: np.ndarray, dead: float) -> np.ndarray:
    return np.zeros(3) if np.linalg.norm(vector) < dead else vector


def _at_most(vector: np.ndarray, longest: float) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    return vector * (longest / length) if length > longest else vector
