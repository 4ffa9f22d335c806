"""A robot on the simulated bench to calibrate, in lockstep: driven like the real one, and its truth can be looked at."""

from collections.abc import Callable

import numpy as np

from rtctl.calibrate.errors import CalibrationError
from rtctl.lockstep import Lockstep
from rtctl.settings import Settings
from rtctl.simulation import LockstepOperator, Recorder
from rtctl.workflow import Progress, Script

PREPARATION = ("enable", "home")
POSE = "pose_gripper_in_base"


class SimulatedRobot:
    """A lockstep run of which no rows are kept.

    Raises:
        BackendError: the backend cannot run in lockstep.
    """

    def __init__(self, settings: Settings, seed: int) -> None:
        recorder = Recorder()

        def look(records: np.ndarray, _truths: np.ndarray) -> None:
            recorder.watcher.watch(records)

        self.settings = settings
        self.lockstep = Lockstep(settings, seed, look)
        self.operator = LockstepOperator(self.lockstep, recorder)
        self.robot = self.lockstep.controller.robot

    def script(self, steps: tuple[str, ...], report: Callable[[Progress], None] = lambda _: None) -> Script:
        """A script of `steps` that has enabled and homed the robot.

        Raises:
            WorkflowError: it cannot be homed.
        """
        script = Script(self.operator, report, (*PREPARATION, *steps))
        script.enable_and_home(self.settings)
        return script

    def middle(self) -> np.ndarray:
        """Pose (dof,) in the middle of the workspace box."""
        return (self.robot.record["box_low"][0] + self.robot.record["box_high"][0]) / 2

    def true_pose(self) -> np.ndarray:
        """Where the gripper really is, pose (dof,) in {B}.

        Raises:
            CalibrationError: this simulation does not tell.
        """
        truth = self.lockstep.truth
        if POSE not in (truth.dtype.names or ()):
            name = self.settings.backend.name
            raise CalibrationError("this simulation does not tell where the gripper really is", value=name)
        return np.array(truth[POSE][0], dtype=float)

    def close(self) -> None:
        """Remove power and release the backend."""
        self.lockstep.close()
