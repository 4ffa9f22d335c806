"""The words between a client and the tick: verbs, the command row, and the reasons a command is refused."""

import enum
from dataclasses import dataclass
from typing import Any

import numpy as np

from hal.errors import RtctlError

COMMAND = np.dtype(
    [
        ("sequence", "i8"),
        ("argument", "f8", (8,)),
        ("deadline_tick", "i8"),
        ("source", "u8"),
        ("verb", "i4"),
        ("slot", "i4"),
    ],
    align=True,
)
"""One command as the tick reads it. `slot` names the staging slot of a plan or parameter set."""


class Verb(enum.IntEnum):
    """What a client can ask of the controller. The arguments are those of `argument`, in order."""

    NONE = 0
    ENABLE = 1
    DISABLE = 2
    PAUSE = 3
    RESUME = 4
    HOME = 5
    STOP = 6
    ACKNOWLEDGE = 7
    MOVE_CP = 8
    """pose (dof), straight there and stop"""
    SERVO_CP = 9
    """pose (dof), replaced by the next one; silence stops"""
    SERVO_CV = 10
    """rate of the pose (dof); silence stops"""
    APPROACH = 11
    """to the first pose of the plan in force"""
    INSERT = 12
    """depth [mm], speed [mm/s] along the plan in force"""
    RETRACT = 13
    """depth [mm] to go back to, speed [mm/s]; the stylet stays where it is"""
    REGISTER_ENTRY = 14
    LOAD_ARRAY = 15
    UNLOAD_ARRAY = 16
    UNBIAS = 17
    LOAD_PLAN = 18
    """number of the plan; the plan itself is in the staging slot"""
    SET_PARAMETERS = 19
    """number of the set; the set itself is in the staging slot"""


class Reason(enum.IntEnum):
    """Verdict on a command."""

    NONE = 0
    ACCEPTED = 1
    WRONG_STATE = 2
    NOT_HOMED = 3
    BUSY = 4
    EXPIRED = 5
    NOT_FINITE = 6
    OUTSIDE_BOX = 7
    STROKE_LIMIT = 8
    SINGULAR = 9
    SPEED = 10
    DEPTH = 11
    NO_PLAN = 12
    NOT_AT_ENTRY = 13
    NO_ARRAY = 14
    ARRAY_LOADED = 15
    NOT_UNBIASED = 16
    NOT_REAL_TIME = 17
    STILL_PRESENT = 18
    NO_PROFILE = 19
    STALE_SLOT = 20
    NOT_REGISTERED = 21
    NO_POWER = 22
    UNKNOWN_VERB = 23
    INSERTED = 24
    AXES_UNKNOWN = 25


@dataclass(frozen=True)
class Explanation:
    """Text of a refusal and what the user should do; `{value}` and `{bound}` are filled in."""

    text: str
    remedy: str


EXPLANATIONS: dict[Reason, Explanation] = {
    Reason.WRONG_STATE: Explanation("not possible in the present state", "look at `rtctl status`, then enable, resume or acknowledge"),
    Reason.NOT_HOMED: Explanation("the robot is not homed", "run `rtctl home`"),
    Reason.BUSY: Explanation("another motion or routine is under way", "wait for it, or run `rtctl stop`"),
    Reason.EXPIRED: Explanation("the command arrived {value:.0f} ticks after its validity ended", "check the client's clock and the load of the machine, then send it again"),
    Reason.NOT_FINITE: Explanation("an argument is not a finite number", "send finite numbers only"),
    Reason.OUTSIDE_BOX: Explanation("coordinate {bound:.0f} (from 0) at {value:.4g} leaves the workspace box", "choose a pose inside [robot] box_low/box_high"),
    Reason.STROKE_LIMIT: Explanation("joint {bound:.0f} (from 0) at {value:.4g} mm leaves its stroke", "choose a pose the pistons can reach"),
    Reason.SINGULAR: Explanation("the way comes to a singular pose after {value:.0%} of it", "choose a smaller rotation"),
    Reason.SPEED: Explanation("speed {value:.4g} is outside (0, {bound:.4g}]", "ask for a speed at which this way respects the limits of [trajectory] and [stylet]"),
    Reason.DEPTH: Explanation("depth {value:.4g} mm is outside the plan or not ahead (limit {bound:.4g} mm)", "choose a depth inside the plan"),
    Reason.NO_PLAN: Explanation("there is no insertion plan", "run `rtctl plan`, or `rtctl insert`"),
    Reason.NOT_AT_ENTRY: Explanation("the gripper is {value:.3g} mm from the first pose of the plan (at most {bound:.3g})", "run the approach first"),
    Reason.NO_ARRAY: Explanation("no array is loaded", "load one and say so with `rtctl load-array`"),
    Reason.ARRAY_LOADED: Explanation("an array is loaded", "take it out and say so with `rtctl unload-array`"),
    Reason.NOT_UNBIASED: Explanation("the force sensor has not been unbiased since the array was loaded", "run `rtctl unbias`"),
    Reason.NOT_REAL_TIME: Explanation("the loop is not real-time, so hardware stays unarmed", "see `rtctl status` for the grade; start with --allow-best-effort on a bench without a patient"),
    Reason.STILL_PRESENT: Explanation("the cause of the fault or pause is still present", "remove the cause shown by `rtctl status`, then try again"),
    Reason.NO_PROFILE: Explanation("no motion profile exists within the limits (planner result {value:.0f})", "check the limits in [trajectory]"),
    Reason.STALE_SLOT: Explanation("the staged data were replaced before they took effect", "send the command again"),
    Reason.NOT_REGISTERED: Explanation("the entry is not registered", "move the gripper to the entry and run `rtctl register`"),
    Reason.NO_POWER: Explanation("the amplifiers are not energised", "run `rtctl enable`"),
    Reason.INSERTED: Explanation("the array is {value:.3g} mm inside the cochlea", "retract it, or end the insertion with `rtctl stop`"),
    Reason.AXES_UNKNOWN: Explanation("the angle of motor {value:.0f} (from 0) is not known yet", "wait until its encoder or drive answers (`rtctl devices list`), then enable"),
    Reason.UNKNOWN_VERB: Explanation("unknown command number {value:.0f}", "update the client"),
}  # fmt: skip


def explain(reason: int, value: float, bound: float) -> tuple[str, str]:
    """Text and remedy of a refusal with its value and bound filled in."""
    e = EXPLANATIONS[Reason(reason)]
    return e.text.format(value=value, bound=bound), e.remedy


class CommandRefused(RtctlError):
    """The controller did not do it, and says why.

    `reason` is one word: a reason of :class:`rtctl.commands.Reason` in lower case, or one of the gateway's.
    """

    exit_code = 4

    def __init__(self, reason: str, what: str, *, value: object = None, bound: str = "", remedy: str = "") -> None:
        self.reason = reason
        self.blackbox: dict[str, Any] | None = None
        """refused in FAULT: what the last ticks before it were, see :meth:`rtctl.client.Client.blackbox`"""
        super().__init__(what, value=value, bound=bound, remedy=remedy)

    def __str__(self) -> str:
        return f"{self.what}; {self.remedy}" if self.remedy else self.what
