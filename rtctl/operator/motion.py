"""From the operator's twist to a rate of the pose: dead zone, speed stage, limits, and what the robot can do at all."""

from dataclasses import dataclass

import numpy as np

from hal.errors import RtctlError
from rtctl import robots
from rtctl.operator.message import Frame
from rtctl.robots.orientation import euler_rates

STAGES = (0.1, 0.25, 0.5, 1.0)
"""Speed stages: the twist is multiplied by one of these."""

COORDINATES: dict[str, tuple[int, ...]] = {
    "planar_3rpr": (0, 1, 5),
    "cartesian_4": (0, 1, 2, 5),
    "hexapod": (0, 1, 2, 3, 4, 5),
    "cochlerob": (0, 1, 2, 3, 5),
}
"""Kind of robot -> the component of the twist (vx, vy, vz, wx, wy, wz) that each entry of its pose follows.

Three angles at the end are Euler angles (rtctl/robots/orientation.py): together they follow the angular velocity.
"""


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
        if kind not in COORDINATES:
            remedy = "say in rtctl/operator/motion.py which components its pose follows"
            raise RtctlError(
                "a robot that cannot be driven by hand", value=kind, bound=" | ".join(COORDINATES), remedy=remedy
            )
        self._components = np.array(COORDINATES[kind])
        self._others = np.setdiff1d(np.arange(6), self._components)
        self._has_euler_angles = COORDINATES[kind][-3:] == (3, 4, 5)
        self._limits = limits
        self._robot = robots.load(kind, {})  # how it turns with its pose is no matter of its geometry

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
            turn = self._robot.rotation(pose)
            v, w = turn @ v, turn @ w
        v = stage * _live(v, limits.dead_mm_per_s)
        w = stage * _live(w, limits.dead_rad_per_s)
        whole = np.concatenate([v, w])
        dropped = bool((np.abs(whole[self._others]) > stage * _dead(self._others, limits)).any())
        whole[self._others] = 0.0
        whole[:3] = _at_most(whole[:3], limits.speed_mm_per_s)
        whole[3:] = _at_most(whole[3:], limits.speed_rad_per_s)
        if self._has_euler_angles:
            whole[3:] = euler_rates(pose[-2], pose[-1], *whole[3:])
        return whole[self._components], dropped


def _dead(components: np.ndarray, limits: Limits) -> np.ndarray:
    return np.where(components < 3, limits.dead_mm_per_s, limits.dead_rad_per_s)


def _live(vector: np.ndarray, dead: float) -> np.ndarray:
    return np.zeros(3) if np.linalg.norm(vector) < dead else vector


def _at_most(vector: np.ndarray, longest: float) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    return vector * (longest / length) if length > longest else vector
