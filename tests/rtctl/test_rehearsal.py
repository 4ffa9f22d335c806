"""What a loop may call has been called before it is ready: nothing is compiled or loaded while it runs."""

import subprocess
import sys

SCRIPT = """
import numpy as np
from hal.backend import load as load_backend
from hal.kernel import loaded
from rtctl import clock
from rtctl.commands import COMMAND, Verb
from rtctl.controller import Controller
from rtctl.exchange.mailbox import post
from rtctl.exchange.segment import Segment
from rtctl.handover import layout
from rtctl.lifecycle import Motion
from rtctl.loop import Loop
from rtctl.rehearsal import Understudy, rehearse, resting_path
from rtctl.settings import load

settings = load("planar-sim")
backend = load_backend("plant", settings.backend.options, period_s=0.001, seed=1)
rehearse(settings, backend)
controller = Controller(settings)
segment = Segment.create(layout(controller, backend))
backend.open()
backend.read(0, controller.sensors)
backend.write(0, controller.actuators)
cruising = Loop(controller, backend, segment, 500, True)
loop = Loop(controller, Understudy(backend), segment, 500, True)  # always under power
ready = loaded()
grid = clock.grid(0.001)
row = np.zeros(1, COMMAND)
row["deadline_tick"] = 2**62
pose = controller.robot.home_pose + [5.0, 5.0, 0.0]
arguments = {Verb.INSERT: (1.0, 1.0), Verb.RETRACT: (0.0, 1.0), Verb.SERVO_CV: (0.1, 0.0, 0.0)}
state = controller.memory["state"][0]
verdicts = {}
for homed in (False, True):
    for verb in Verb:
        if homed:  # every motion is accepted, so that the planner runs to its end
            state["homed"], state["operating"], state["motion"], state["plan_number"] = 1, 1, Motion.HOLD, 1
            state["array_loaded"], state["unbiased"], state["task"], state["on_path"] = 1, 1, 2, verb == Verb.RETRACT
            state["pose"] = state["setpoint"][:-1] = state["reference"] = pose
            state["setpoint"][-1] = 1.0 if verb == Verb.RETRACT else 0.0
            state["setpoint_rate"] = state["setpoint_acceleration"] = state["unbias_left"] = 0
            controller.memory["plan"], controller.memory["profile"]["duration_s"] = resting_path(pose), 0.0
        row["verb"], row["argument"] = verb, 0.0
        given = arguments.get(verb, pose)
        row["argument"][0, : len(given)] = given
        post(segment.mailbox, row[0])
        loop.cycle(grid)
        verdicts[verb.name] = int(controller.record["command_verdict"][0])
        cruising.cruise(grid, 2, *cruising.cruise_arguments)
cruising.run(grid, ticks=3)
print("late:", sorted(loaded() - ready))
print("verdicts:", verdicts)
"""


def test_no_command_loads_a_kernel_that_was_not_rehearsed():
    out = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True).stdout
    assert "late: []" in out, out
    for verb in ("MOVE_CP", "SERVO_CP", "SERVO_CV", "APPROACH", "INSERT", "RETRACT"):
        assert f"'{verb}': 1," in out, out
