"""A robot as Python code outside the tick sees it: named, checked, with errors that explain themselves."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hal.errors import OptionError, RtctlError
from hal.kernel import kernel
from rtctl.robots import interface


class RobotError(RtctlError):
    """A pose or a geometry the mechanism cannot realise."""


@dataclass(frozen=True, eq=False)
class Robot:
    """One robot with its geometry; every method calls the kernel the tick calls.

    Attributes:
        kind: name in the registry.
        pose_names: names of the pose's entries, units included.
        joint_names: names of the joints, in the order of the motors.
        joint_units: "mm" or "rad" of every joint.
        record: geometry and limits, shape (1,); the tick passes `record[0]` to the kernels.
        translation_mask: which translations along x, y, z of {B} the robot has.
        length_dofs: how many entries of the pose, from the first on, are lengths [mm]; the rest are angles [rad].
        singular_error: what to tell about a pose (dof,) that `reach` calls SINGULAR; None if it calls none so.
    """

    kind: str
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    record: np.ndarray
    translation_mask: tuple[bool, bool, bool]
    length_dofs: int
    singular_error: Callable[[np.ndarray], RobotError] | None = None

    @property
    def dof(self) -> int:
        """Number of pose entries, joints and motors."""
        return len(self.pose_names)

    @property
    def home_pose(self) -> np.ndarray:
        """Pose (dof,) in {B} at which all motor angles are zero; a copy."""
        return self.record["home_pose"][0].copy()

    def inverse(self, pose: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Joint values (dof,) [`joint_units`] and motor angles (dof,) [rad] of `pose` (dof,) in {B}.

        Limits are not looked at: see `explain`.

        Raises:
            RobotError: wrong shape, or the mechanism cannot be assembled there.
        """
        joint, motor = np.empty(self.dof), np.empty(self.dof)
        if not _inverse(self.record, self._vector("pose", pose), joint, motor):
            raise RobotError("no assembly of the robot has this pose", value=_plain(pose), remedy="see Robot.explain")
        return joint, motor

    def forward(self, motor: ArrayLike, start: ArrayLike | None = None) -> np.ndarray:
        """Pose (dof,) in {B} at the motor angles `motor` (dof,) [rad], found from the pose `start` (default home).

        Raises:
            RobotError: wrong shape, or the iteration does not converge.
        """
        pose = self.home_pose if start is None else self._vector("start", start).copy()
        if _forward(self.record, self._vector("motor", motor), pose) < 0:
            raise RobotError(
                "forward kinematics does not converge",
                value=_plain(motor),
                remedy="start from a pose near the solution, and check the motor angles and the home offset",
            )
        return pose

    def jacobian(self, pose: ArrayLike) -> np.ndarray:
        """d motor / d pose (dof, dof) at `pose` (dof,) in {B}; RobotError for a wrong shape."""
        matrix = np.empty((self.dof, self.dof))
        _jacobian(self.record, self._vector("pose", pose), matrix)
        return matrix

    def rotation(self, pose: ArrayLike) -> np.ndarray:
        """Rotation (3, 3) of the gripper in {B} at `pose` (dof,); RobotError for a wrong shape."""
        matrix = np.empty((3, 3))
        _rotation(self.record, self._vector("pose", pose), matrix)
        return matrix

    def reach(self, pose: ArrayLike) -> int:
        """REACHABLE, OUTSIDE_BOX, STROKE_LIMIT or SINGULAR (see `interface`) for `pose` (dof,) in {B}.

        Raises:
            RobotError: wrong shape.
        """
        return int(_reach(self.record, self._vector("pose", pose)))

    def explain(self, pose: ArrayLike) -> RobotError | None:
        """Why the robot may not go to `pose` (dof,) in {B}, and what to do about it; None if it may.

        Raises:
            RobotError: wrong shape.
        """
        pose = self._vector("pose", pose)
        answer = _reach(self.record, pose)
        if answer == interface.OUTSIDE_BOX:
            return self._outside_box(pose)
        if answer == interface.STROKE_LIMIT:
            return self._stroke_limit(pose)
        if answer == interface.SINGULAR and self.singular_error is not None:
            return self.singular_error(pose)
        return None

    def _outside_box(self, pose: np.ndarray) -> RobotError:
        low, high = self.record["box_low"][0], self.record["box_high"][0]
        k = int(np.flatnonzero(~((low <= pose) & (pose <= high)))[0])
        return RobotError(
            f"{self.pose_names[k]} of the pose is outside the workspace box",
            value=float(pose[k]),
            bound=f"{low[k]:g} .. {high[k]:g} {'mm' if k < self.length_dofs else 'rad'}",
            remedy="choose a pose inside the box, or change the box in robot.geometry",
        )

    def _stroke_limit(self, pose: np.ndarray) -> RobotError:
        joint, motor = np.empty(self.dof), np.empty(self.dof)
        _inverse(self.record, pose, joint, motor)
        low, high = self.record["joint_low"][0], self.record["joint_high"][0]
        excess = np.maximum(low - joint, joint - high)
        k = int(np.argmax(excess))  # NaN, a joint that cannot get there at all, counts as the largest
        return RobotError(
            f"{self.joint_names[k]} cannot reach the pose {_plain(pose)}",
            value=float(joint[k]),
            bound=f"{low[k]:g} .. {high[k]:g} {self.joint_units[k]}",
            remedy="choose a pose nearer to the middle of the workspace, or change the joint limits in robot.geometry",
        )

    def _vector(self, name: str, values: ArrayLike) -> np.ndarray:
        """Compiled code does not check bounds, so nothing of a wrong shape may pass."""
        vector = np.ascontiguousarray(values, dtype=float)
        if vector.shape != (self.dof,):
            raise RobotError(f"{name} of {self.kind} has a wrong shape", value=vector.shape, bound=f"({self.dof},)")
        return vector


def ordered(low_name: str, low: tuple[float, ...], high_name: str, high: tuple[float, ...]) -> None:
    """Check two limits of robot.geometry, entry by entry. Raises OptionError: one that is not below the other."""
    for k, (a, b) in enumerate(zip(low, high, strict=True)):
        if a >= b:
            what = f"robot.geometry.{low_name}[{k}] is not below {high_name}[{k}]"
            raise OptionError(what, value=a, bound=f"below {b:g}", remedy="set both")


def check_home(robot: Robot) -> None:
    """Raises RobotError: the home of `robot` is outside its own limits."""
    problem = robot.explain(robot.home_pose)
    if problem is not None:
        what, remedy = f"home is not usable: {problem.what}", "check the geometry and the limits in robot.geometry"
        raise RobotError(what, value=problem.value, bound=problem.bound, remedy=remedy)


def _plain(values: ArrayLike) -> list[float]:
    return [round(float(v), 6) for v in np.asarray(values, dtype=float)]


@kernel
def _inverse(record, pose, joint, motor):
    return interface.inverse(record[0], pose, joint, motor)


@kernel
def _forward(record, motor, pose):
    return interface.forward(record[0], motor, pose)


@kernel
def _jacobian(record, pose, matrix):
    interface.jacobian(record[0], pose, matrix)


@kernel
def _rotation(record, pose, matrix):
    interface.rotation(record[0], pose, matrix)


@kernel
def _reach(record, pose):
    return interface.reach(record[0], pose)
