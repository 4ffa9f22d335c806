"""Everything a loop will ever call, called once on throw-away copies: nothing is left to compile or to page in."""

import numpy as np

from hal.backend import Backend, CompiledDevice
from hal.frames import VALID
from hal.signals import Table
from rtctl import clock as clocks
from rtctl.commands import COMMAND, Verb
from rtctl.controller import Controller
from rtctl.electrode.path import PATH
from rtctl.exchange.control import Word, get, put
from rtctl.exchange.mailbox import post
from rtctl.exchange.segment import Segment
from rtctl.handover import layout
from rtctl.lifecycle import Motion
from rtctl.loop import Loop
from rtctl.propose import PLANNED
from rtctl.settings import Settings

FAR = 2**62


def rehearse(settings: Settings, backend: Backend) -> None:
    """Run a loop through every kind of command with the exact types of the real one; the devices are left alone."""
    controller = Controller(settings)
    segment = Segment.create(layout(controller, backend))
    clock = clocks.make(settings.loop)
    loop = Loop(controller, Understudy(backend), segment, heartbeat_ticks=1, may_arm=True)
    Loop(controller, backend, segment, heartbeat_ticks=1, may_arm=True)  # makes its kernel for this device
    state = controller.memory["state"][0]
    row = np.zeros(1, COMMAND)
    row["deadline_tick"] = FAR
    dof = controller.robot.dof
    for verb in (Verb.NONE, Verb.ENABLE, Verb.LOAD_PLAN, Verb.SET_PARAMETERS, Verb.HOME, *sorted(PLANNED)):
        row["verb"], row["argument"] = verb, 0.0
        if verb in (Verb.INSERT, Verb.RETRACT):
            row["argument"][0, :2] = 0.5 if verb == Verb.INSERT else 0.0, 0.1
        else:
            row["argument"][0, :dof] = controller.robot.home_pose
        post(segment.mailbox, row[0])
        loop.cycle(clock)
        if verb == Verb.HOME:  # as if the stops had been found, so that kinematics and planning run, too
            controller.memory["plan"] = resting_path(controller.robot.home_pose)
            state["homed"], state["plan_number"] = 1, 1
            state["pose"] = state["setpoint"][:-1] = state["reference"] = controller.robot.home_pose
        state["motion"] = Motion.HOLD  # or the next motion would be refused before anything of it is planned
    put(segment.control, Word.GRADE, get(segment.control, Word.GRADE))
    loop.run(clock, ticks=1)
    segment.close()


def resting_path(pose: np.ndarray) -> np.ndarray:
    """A path (1,) of 1 mm depth that stays at `pose` (dof,)."""
    path = np.zeros(1, PATH)
    path["intervals"], path["channels"], path["depth_mm"][0, 1] = 1, len(pose) + 1, 1.0
    path["coefficient"][0, 0, : len(pose), 3] = pose
    return path


class Understudy:
    """Stands in for a backend: same frames and the same truth, nothing behind them."""

    simulated = True

    def __init__(self, backend: Backend) -> None:
        self.axes, self.watchdog_ticks = backend.axes, backend.watchdog_ticks
        truth = backend.truth()
        self._truth = None if truth is None else (truth[0], np.zeros_like(truth[1]))

    def open(self) -> None:
        """Nothing to open."""

    def read(self, _tick: int, sensors: np.ndarray) -> None:
        """Everything valid and zero, under power."""
        sensors["powered"], sensors["device_time_s"] = 1, np.nan
        for group in ("axes", "wrench", "impedance"):
            sensors[f"{group}_validity"] = VALID

    def write(self, _tick: int, _actuators: np.ndarray) -> None:
        """Nothing moves."""

    def close(self) -> None:
        """Nothing to close."""

    def compiled(self) -> CompiledDevice | None:
        """No kernels."""
        return None

    def truth(self) -> tuple[Table, np.ndarray] | None:
        """The layout of the other's truth, all zero."""
        return self._truth
