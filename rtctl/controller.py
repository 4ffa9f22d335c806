"""A controller ready to tick: its memory, the frames it exchanges, and the planner beside it."""

import numpy as np

from hal.frames import actuator_frame, sensor_frame
from rtctl import robots
from rtctl.commands import COMMAND
from rtctl.guidance import detector_file, layout
from rtctl.memory import memory_dtype
from rtctl.parameters import pack
from rtctl.propose import Proposer
from rtctl.record import controller_table
from rtctl.settings import Settings
from rtctl.tick import step_arrays


class Controller:
    """State and scratch of one controller, allocated once; :meth:`step` runs one tick on it.

    Args:
        settings: what the controller believes about the world.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.robot = robots.load(settings.robot.kind, settings.robot.geometry)
        dof = self.robot.dof
        self.axes = dof + 1
        self.table = controller_table(dof)
        self.memory = np.zeros(1, memory_dtype(self.robot.record.dtype, dof))
        self.sensors = np.zeros(1, sensor_frame(self.axes))
        self.actuators = np.zeros(1, actuator_frame(self.axes))
        self.record = np.zeros(1, self.table.dtype)
        self.proposer = Proposer(dof)
        m = self.memory[0]
        m["robot"] = self.robot.record[0]
        m["parameters"] = pack(settings, self.robot, 1)[0]
        if settings.guidance.detector:
            m["detector"] = layout.pack(detector_file.from_table(settings.guidance.model))[0]
        state = m["state"]
        for name in ("pose", "pose_goal", "pose_entry", "reference", "joint_reference", "angle_rad"):
            state[name] = np.nan
        state["setpoint"][:dof] = np.nan
        state["fault_cause"] = state["stop_cause"] = -1

    @property
    def command(self) -> np.ndarray:
        """The command row of this tick, shape (1,): written by whoever feeds the controller."""
        return self.memory["command"]

    def order(self, command: np.void | None) -> None:
        """Set the command of the next tick; None for no command."""
        self.memory["command"] = np.zeros(1, COMMAND) if command is None else command

    def propose(self, tick: int) -> None:
        """Plan the profile for the command of grid tick `tick`, if it needs one."""
        self.proposer.propose(self.memory, tick)

    def step(self) -> None:
        """Run one tick on the frames and the record as they are."""
        step_arrays(self.memory, self.sensors, self.actuators, self.record)
