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
from rtctl.electrode.path import evaluate_path
from rtctl.lifecycle import Motion
from rtctl.robots.interface import OUTSIDE_BOX, REACHABLE, SINGULAR, STROKE_LIMIT, inverse, reach

RATE_STEP_MM = 0.1
"""Distance of the depths at which a path's slope is looked at."""
FLAT = 1e-9
"""Slope below which a coordinate does not limit the rate."""
STANDING = 1e-6
"""A coordinate [mm or rad] that changes by less does not bend a straight line."""
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
        self.finding = np.empty(2)
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
            self._propose_depth(memory, verb)

    def _propose_pose(self, memory: np.ndarray, goal: np.ndarray, whole_way: bool) -> None:
        m, robot = memory[0], memory["robot"]
        state, parameters, proposal = m["state"], m["parameters"], m["proposal"]
        if not state["homed"]:
            return None  # refused before anybody looks at the profile
        start = state["reference" if state["on_path"] else "setpoint"][: self.dof]
        finding = self.finding
        answer = first_unreachable(robot, start.copy(), goal.copy(), WAY_POINTS if whole_way else 1, finding)
        if answer != REACHABLE:
            return _refuse(proposal, REASON_OF_REACH[answer], finding[0], finding[1])
        i = self.pose_input
        i.current_position, i.target_position = start, goal
        i.current_velocity = state["setpoint_rate"][: self.dof]
        i.current_acceleration = state["setpoint_acceleration"][: self.dof]
        resting = not (state["setpoint_rate"][: self.dof].any() or state["setpoint_acceleration"][: self.dof].any())
        for name, limit in (("max_velocity", "speed"), ("max_acceleration", "acceleration"), ("max_jerk", "jerk")):
            bounds = parameters[limit][: self.dof]
            setattr(i, name, _along(goal - start, bounds) if whole_way and resting else bounds)
        result = self.pose_planner.calculate(i, self.pose_trajectory)
        _adopt(proposal, 0, self.pose_trajectory, result)
        return None

    def _propose_depth(self, memory: np.ndarray, verb: int) -> None:
        m = memory[0]
        state, parameters, proposal = m["state"], m["parameters"], m["proposal"]
        goal, speed = m["command"]["argument"][:2]
        if verb == Verb.RESUME:
            paused = int(state["paused_motion"])
            if paused not in (Motion.INSERT, Motion.RETRACT):
                return None
            verb = Verb.INSERT if paused == Motion.INSERT else Verb.RETRACT
            goal, speed = state["depth_goal_mm"], state["depth_speed_mm_per_s"]
        depth, fastest = state["setpoint"][self.dof], parameters["speed"][self.dof]
        end = m["plan"]["depth_mm"][m["plan"]["intervals"]]
        forward = verb == Verb.INSERT
        if not 0.0 < speed <= fastest:
            return _refuse(proposal, Reason.SPEED, speed, fastest)
        if not 0.0 <= goal <= end or (goal < depth if forward else goal > depth):
            return _refuse(proposal, Reason.DEPTH, goal, end if forward and goal > end else depth)
        stylet_speed = parameters["stylet_step_mm"] / parameters["period_s"] if forward else math.inf
        fastest = fastest_rate(
            memory["plan"], depth, goal, parameters["speed"], parameters["length_dofs"], stylet_speed
        )
        if speed > fastest:
            return _refuse(proposal, Reason.SPEED, speed, fastest)
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


def _along(way: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Limits (dof,) in proportion to the way, none above `limits`: with them ruckig stays on the straight line.

    With any others it gives the line up where the slowest coordinate's profile is too fast for another coordinate.
    """
    size = np.abs(way)
    moving = size > STANDING
    scaled = limits.copy()
    if moving.any():
        scaled[moving] = size[moving] * (limits[moving] / size[moving]).min()
    return scaled


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
def fastest_rate(paths, start_mm, goal_mm, speed, lengths, stylet_speed):
    """Largest depth rate [mm/s] at which no coordinate between two depths of the path exceeds its own speed.

    speed (dof + 1,) holds the limits of the coordinates, the first `lengths` of which share one over their norm.
    """
    path, dof = paths[0], speed.shape[0] - 1
    value, slope = np.empty(dof + 1), np.empty(dof + 1)
    steps = max(math.ceil(abs(goal_mm - start_mm) / RATE_STEP_MM), 1)
    rate = math.inf
    for k in range(steps + 1):
        evaluate_path(path, start_mm + (goal_mm - start_mm) * k / steps, value, slope)
        squares = 0.0
        for i in range(lengths):
            squares += slope[i] * slope[i]
        rate = min(rate, speed[0] / max(math.sqrt(squares), FLAT))
        for i in range(lengths, dof):
            rate = min(rate, speed[i] / max(abs(slope[i]), FLAT))
        rate = min(rate, stylet_speed / max(abs(slope[dof]), FLAT))
    return rate


@kernel
def first_unreachable(robots, start, goal, points, finding):
    """Answer of `reach` for the first pose of the straight way the robot cannot take, REACHABLE if there is none.

    Into `finding` (2,): value and number of the coordinate or joint that leaves its limits; the share of the way up to
    a singular pose. A way that begins outside may lead back in: wherever the robot is, it can return.
    """
    robot, dof = robots[0], start.shape[0]
    at, joint, motor = start.copy(), np.empty(dof), np.empty(dof)
    inside = reach(robot, start) == REACHABLE
    for k in range(1, points + 1):
        share = k / points
        for i in range(dof):
            at[i] = start[i] + share * (goal[i] - start[i])
        answer = reach(robot, at)
        inside = inside or answer == REACHABLE
        if answer == REACHABLE or (not inside and k < points):
            continue
        if answer == OUTSIDE_BOX:
            _note_first(at, robot.box_low, robot.box_high, finding)
        elif answer == STROKE_LIMIT:
            inverse(robot, at, joint, motor)
            _note_first(joint, robot.joint_low, robot.joint_high, finding)
        elif answer == SINGULAR:
            finding[0], finding[1] = share, math.nan
        return answer
    return REACHABLE


@kernel
def _note_first(values, low, high, finding):
    for i in range(values.shape[0] - 1, -1, -1):
        if not low[i] <= values[i] <= high[i]:
            finding[0], finding[1] = values[i], float(i)


@kernel
def clear(proposals, tick):
    """:func:`rtctl.profile.clear` for Python callers, who pass arrays (1,)."""
    profiles.clear(proposals[0], tick)
