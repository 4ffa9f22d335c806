"""Everything a loop will ever call, called once on throw-away copies: nothing is left to compile or to page in."""

import numpy as np

from hal.backend import Backend
from hal.frames import VALID
from rtctl import clock as clocks
from rtctl.commands import Verb
from rtctl.controller import Controller
from rtctl.exchange.mailbox import fetch
from rtctl.exchange.poll import new_poller
from rtctl.exchange.segment import Segment
from rtctl.handover import layout
from rtctl.loop import begin, finish, publish_truth
from rtctl.propose import PLANNED
from rtctl.settings import Settings


def rehearse(settings: Settings, backend: Backend) -> None:
    """Exercise tick, planner, clock and shared memory with the exact types the loop uses; devices are left alone."""
    controller = Controller(settings)
    segment = Segment.create(layout(controller, backend))
    clock = clocks.grid(settings.loop.period_s)
    poller = new_poller(segment.control)
    memory, sensors, state = controller.memory, controller.sensors[0], controller.memory["state"][0]
    truth = backend.truth()
    for verb in (Verb.NONE, Verb.ENABLE, Verb.HOME, *PLANNED):
        begin(clock, segment.control, segment.mailbox, poller, memory, controller.record, 1, 0)
        memory["command"]["verb"] = verb
        memory["command"]["deadline_tick"] = 2**62
        controller.command["argument"][0, : controller.axes - 1] = controller.robot.home_pose
        controller.propose(int(clock["tick"][0]))
        sensors["powered"], sensors["axes_validity"], sensors["wrench_validity"] = 1, VALID, VALID
        controller.step()
        finish(clock, controller.record, segment.records, segment.control)
        if truth is not None:
            publish_truth(controller.record, np.zeros_like(truth[1]), segment.truths)
        if verb == Verb.HOME:  # as if the stops had been found, so that kinematics and planning run, too
            state["homed"], state["plan_number"] = 1, 1
            state["pose"] = state["setpoint"][:-1] = state["reference"] = controller.robot.home_pose
    fetch(segment.plans, 0, 1, memory["staged_plan"][0])
    fetch(segment.parameters, 0, 1, memory["staged_parameters"][0])
    segment.close()
