"""The motion profile for a command, planned beside the tick when the goal changes, never in it.

ruckig plans state to state only. Its result is copied into the piecewise cubics of :mod:`rtctl.profile`; whether the
profile is adopted is decided by the tick. What is planned depends on the memory and the command alone, so a replay
plans the same.
"""

import math

import numpy as np
from ruckig import InputParameter, Result, Ruckig, Synchronization, Trajectory

from hal.kernel import kernel
from rtctl import profile as profiles
from rtctl.commands import Reason, Verb
from rtctl.lifecycle import Motion
from rtctl.robots.interface import OUTSIDE_BOX, REACHABLE, SINGULAR, STROKE_LIMIT, reach

WAY_POINTS = 64
"""Poses of a straight way that are checked against the workspace."""

REASON_OF_REACH = {
    OUTSIDE_BOX: Reason.OUTSIDE_BOX,
    STROKE_LIMIT: Reason.STROKE_LIMIT,
    SINGULAR: Reason.SINGULAR,
}


class Proposer:
    """Plans motion profiles for a controller of `dof` pose coordinates."""

    def __init__(self, dof: int) -> None:
        self.dof = dof
        self.pose_planner, self.pose_input, self.pose_trajectory = Ruckig(dof), InputParameter(dof), Trajectory(dof)
        self.pose_input.synchronization = Synchronization.Phase
        self.depth_planner, self.depth_input, self.depth_trajectory = Ruckig(1), InputParameter(1), Trajectory(1)

    def propose(self, memory: np.ndarray, tick: int) -> None:
        """Put a profile, or the reason why there is none, into memory.proposal if the command is a motion.

        memory: the controller's memory, shape (1,); its command is the one of grid tick `tick`.
        """
        m = memory[0]
        verb = int(m["command"]["verb"])
        if verb not in PLANNED or not np.isfinite(m["command"]["argument"]).all():
            return
        clear(memory["proposal"], tick - 1)
        if verb in (Verb.MOVE_CP, Verb.SERVO_CP):
            self._propose_pose(memory, m["command"]["argument"][: self.dof], verb == Verb.MOVE_CP)
        elif verb == Verb.APPROACH:
            if m["state"]["plan_number"] > 0:
                self._propose_pose(memory, m["plan"]["coefficient"][0, : self.dof, 3], True)
        else:
            self._propose_depth(m, verb)

    def _propose_pose(self, memory: np.ndarray, goal: np.ndarray, whole_way: bool) -> None:
        m, robot = memory[0], memory["robot"]
        state, parameters, proposal = m["state"], m["parameters"], m["proposal"]
        if not state["homed"]:
            return  # refused before anybody looks at the profile
        start = state["setpoint"][: self.dof]
        where = first_unreachable(robot, start.copy(), goal.copy(), WAY_POINTS if whole_way else 1)
        if where <= 1.0:
            at = start + where * (goal - start)
            return self._refuse_pose(m["proposal"], robot, at)
        i = self.pose_input
        i.current_position, i.target_position = start, goal
        i.current_velocity = state["setpoint_rate"][: self.dof]
        i.current_acceleration = state["setpoint_acceleration"][: self.dof]
        for name, limit in (("max_velocity", "speed"), ("max_acceleration", "acceleration"), ("max_jerk", "jerk")):
            setattr(i, name, parameters[limit][: self.dof])
        result = self.pose_planner.calculate(i, self.pose_trajectory)
        _adopt(proposal, 0, self.pose_trajectory, result)
        return None

    def _refuse_pose(self, proposal: np.void, robot: np.ndarray, at: np.ndarray) -> None:
        proposal["valid"], proposal["reason"] = 0, REASON_OF_REACH[int(reach_at(robot, at))]
        low, high = robot["box_low"][0], robot["box_high"][0]
        outside = np.flatnonzero(~((low <= at) & (at <= high)))
        if outside.size:
            proposal["reason_value"], proposal["reason_bound"] = at[outside[0]], outside[0]

    def _propose_depth(self, m: np.void, verb: int) -> None:
        state, parameters, proposal = m["state"], m["parameters"], m["proposal"]
        goal, speed = m["command"]["argument"][:2]
        if verb == Verb.RESUME:
            verb = {Motion.INSERT: Verb.INSERT, Motion.RETRACT: Verb.RETRACT}.get(int(state["paused_motion"]), 0)
            goal, speed = state["depth_goal_mm"], state["depth_speed_mm_per_s"]
            if verb == 0:
                return
        depth, fastest = state["setpoint"][self.dof], parameters["speed"][self.dof]
        end = m["plan"]["depth_mm"][m["plan"]["intervals"]]
        forward = verb == Verb.INSERT
        if not 0.0 < speed <= fastest:
            return _refuse(proposal, Reason.SPEED, speed, fastest)
        if not 0.0 <= goal <= end or (goal < depth if forward else goal > depth):
            return _refuse(proposal, Reason.DEPTH, goal, end if forward and goal > end else depth)
        i = self.depth_input
        i.current_position, i.target_position, i.max_velocity = [depth], [goal], [speed]
        i.current_velocity = [state["setpoint_rate"][self.dof]]
        i.current_acceleration = [state["setpoint_acceleration"][self.dof]]
        i.max_acceleration, i.max_jerk = [parameters["acceleration"][self.dof]], [parameters["jerk"][self.dof]]
        result = self.depth_planner.calculate(i, self.depth_trajectory)
        _adopt(proposal, self.dof, self.depth_trajectory, result)
        return None


PLANNED = frozenset({Verb.MOVE_CP, Verb.SERVO_CP, Verb.APPROACH, Verb.INSERT, Verb.RETRACT, Verb.RESUME})


PIECE = ("start_s", "position", "velocity", "acceleration", "jerk")


def _refuse(proposal: np.void, reason: Reason, value: float, bound: float) -> None:
    proposal["valid"], proposal["reason"] = 0, reason
    proposal["reason_value"], proposal["reason_bound"] = value, bound


def _adopt(proposal: np.void, first_channel: int, trajectory: Trajectory, result: Result) -> None:
    """Copy ruckig's pieces: what it brakes first, the seven phases of the move, and rest at the end."""
    if result.value < 0:
        return _refuse(proposal, Reason.NO_PROFILE, float(result.value), math.nan)
    for channel, p in enumerate(trajectory.profiles[0], first_channel):
        pieces, time = [], 0.0
        for phases in (p.brake, p) if p.brake.duration > 0.0 else (p,):
            for t, *start in zip(phases.t, phases.p, phases.v, phases.a, phases.j, strict=False):
                if t > 0.0:
                    pieces.append((time, *start))
                    time += t
        pieces.append((time, p.pf, 0.0, 0.0, 0.0))
        n = proposal["segments"][channel] = len(pieces)
        for name, column in zip(PIECE, zip(*pieces, strict=True), strict=True):
            proposal[name][channel, :n] = column
    proposal["duration_s"] = trajectory.duration
    return None


@kernel
def first_unreachable(robots, start, goal, points):
    """Share 0 .. 1 of the straight way at which the robot can first not follow; 2 if it can follow to the end.

    The start is not judged: from wherever the robot is, it may go back to where it is allowed to be.
    """
    robot = robots[0]
    at = start.copy()
    for k in range(1, points + 1):
        share = k / points
        for i in range(start.shape[0]):
            at[i] = start[i] + share * (goal[i] - start[i])
        if reach(robot, at) != REACHABLE:
            return share
    return 2.0


@kernel
def reach_at(robots, pose):
    """:func:`rtctl.robots.interface.reach` for Python callers, who pass arrays (1,)."""
    return reach(robots[0], pose)


@kernel
def clear(proposals, tick):
    """:func:`rtctl.profile.clear` for Python callers, who pass arrays (1,)."""
    profiles.clear(proposals[0], tick)
