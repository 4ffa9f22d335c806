"""Operating states, and the one table: condition -> reaction -> operator text -> remedy.

The machine is pure: (state, conditions, verb) in, (state, verdict) out. It follows CRTK's operating
states. A condition is a bit; its reaction is what the controller does on its own, without being asked:

NOTE   goes into the record, nothing else;
STOP   ends the motion along a jerk-limited brake and holds;
PAUSE  the same, and nothing moves until somebody resumes;
FAULT  removes power in this very tick and latches until it is acknowledged.

Removing power is safe here because the lead screws cannot be driven back by the array.
"""

import enum
from dataclasses import dataclass

import numpy as np

from hal.kernel import kernel
from rtctl.commands import Reason, Verb


class Operating(enum.IntEnum):
    """CRTK operating state."""

    DISABLED = 0
    ENABLED = 1
    PAUSED = 2
    FAULT = 3


class Task(enum.IntEnum):
    """Where the insertion stands, inside ENABLED or PAUSED."""

    IDLE = 0
    APPROACH = 1
    AT_ENTRY = 2
    INSERTING = 3
    HOLDING = 4
    RETRACTING = 5
    DONE = 6


class Motion(enum.IntEnum):
    """What the high-level controller is following."""

    HOLD = 0
    MOVE = 1
    SERVO_CP = 2
    SERVO_CV = 3
    INSERT = 4
    RETRACT = 5
    HOME = 6


class Reaction(enum.IntEnum):
    """What the controller does by itself; a larger number wins."""

    NOTE = 0
    STOP = 1
    PAUSE = 2
    FAULT = 3


class Condition(enum.IntEnum):
    """Everything that can be wrong, as a bit number."""

    AXES_LOST = 0
    WATCHDOG = 1
    AMPLIFIER = 2
    POWER_LOST = 3
    KINEMATICS = 4
    FOLLOWING_ERROR = 5
    NOT_FINITE = 6
    FORCE_LIMIT = 7
    WRENCH_LOST = 8
    ADMITTANCE_SATURATED = 9
    WORKSPACE = 10
    STREAM_SILENT = 11
    GATEWAY_LOST = 12
    LOG_FAILED = 13
    OPERATOR_LOST = 14
    OVERRUN = 15
    STYLET_LIMIT = 16
    HOMING_FAILED = 17
    SPEED_LIMIT = 18
    BUCKLING = 19
    BUCKLING_WARNING = 20
    TIP_FOLD = 21
    TIP_FOLD_WARNING = 22
    DETECTOR_BLIND = 23
    IMPEDANCE_SILENT = 24
    IMPEDANCE_UNUSABLE = 25
    IMPEDANCE_LOST = 26
    DEVICE_WARNING = 27
    DEVICE_PAUSE = 28
    DEVICE_FAULT = 29
    FORCE_DRIFT = 30
    OVERRUN_PERSISTENT = 31
    OVERRUN_UNABATED = 32
    DEVICE_CLOCK = 33


@dataclass(frozen=True)
class Row:
    """One line of the condition table. `{value}` and `{bound}` are filled in from the record."""

    reaction: Reaction
    text: str
    remedy: str


TABLE: dict[Condition, Row] = {
    Condition.AXES_LOST: Row(Reaction.FAULT, "no valid motor angles for {value:.0f} ticks (limit {bound:.0f})", "check encoder cables and the backend, then acknowledge and home"),
    Condition.WATCHDOG: Row(Reaction.FAULT, "the device removed power because the control loop was silent", "find what stalled the machine (`rtctl log info`), then acknowledge"),
    Condition.AMPLIFIER: Row(Reaction.FAULT, "an amplifier reports not ready", "check its supply and temperature, then acknowledge"),
    Condition.POWER_LOST: Row(Reaction.FAULT, "power was asked for but the amplifiers stayed off for {value:.0f} ticks (limit {bound:.0f})", "check the emergency stop and the enable chain, then acknowledge"),
    Condition.KINEMATICS: Row(Reaction.FAULT, "the motor angles belong to no reachable pose", "home again; if it stays, compare [robot] with the machine"),
    Condition.FOLLOWING_ERROR: Row(Reaction.FAULT, "a motor is {value:.3g} rad from its reference (limit {bound:.3g})", "look for a jam or a cut wire, then acknowledge"),
    Condition.NOT_FINITE: Row(Reaction.FAULT, "a computed command is not a number", "keep the log and report it: `rtctl replay` names the tick"),
    Condition.FORCE_LIMIT: Row(Reaction.PAUSE, "force {value:.3g} N exceeds {bound:.3g} N", "look at the array, then resume or retract"),
    Condition.WRENCH_LOST: Row(Reaction.PAUSE, "no valid force while an array is moved: its last sample is {value:.0f} ticks old (limit {bound:.0f}), or invalid or saturated now", "check the sensor, then resume or retract"),
    Condition.ADMITTANCE_SATURATED: Row(Reaction.PAUSE, "the lateral correction reached {value:.3g} mm (limit {bound:.3g}): near buckling, or a wrong registration", "retract and register again"),
    Condition.WORKSPACE: Row(Reaction.STOP, "the motion came to the edge of the workspace: of its box, of a piston's stroke, or a singular pose", "move back inside"),
    Condition.STREAM_SILENT: Row(Reaction.STOP, "no servo command for {value:.0f} ticks (limit {bound:.0f})", "send the stream again"),
    Condition.GATEWAY_LOST: Row(Reaction.PAUSE, "the gateway is silent", "it is restarted by itself; then resume"),
    Condition.LOG_FAILED: Row(Reaction.PAUSE, "the log cannot be written", "free space on the disk of the log, restart, and resume only if you can do without a record"),
    Condition.OPERATOR_LOST: Row(Reaction.PAUSE, "the client that holds the lease is silent", "start the client again, then resume"),
    Condition.OVERRUN: Row(Reaction.PAUSE, "the loop missed {value:.0f} ticks at once (limit {bound:.0f})", "relieve the machine (see docs/how-to/bring-up-a-target-pc.md), then resume"),
    Condition.STYLET_LIMIT: Row(Reaction.NOTE, "the stylet is withdrawn to its limit", "nothing to do: further withdrawal does not change the array"),
    Condition.HOMING_FAILED: Row(Reaction.STOP, "homing found no end stop within {bound:.0f} ticks", "check power and free motion, then home again"),
    Condition.SPEED_LIMIT: Row(Reaction.NOTE, "the reference was slowed to the speed limit", "nothing to do unless it lasts"),
    Condition.BUCKLING: Row(Reaction.PAUSE, "the array buckles outside the cochlea: forces came to {value:.3g} N over the depth (normal up to {bound:.3g})", "look at the array, then retract; `resume` is possible if guidance.buckling is \"pause\""),
    Condition.BUCKLING_WARNING: Row(Reaction.NOTE, "the array may buckle outside the cochlea: forces came to {value:.3g} N over the depth (normal up to {bound:.3g})", "look at the array; pause the insertion if it bends"),
    Condition.TIP_FOLD: Row(Reaction.PAUSE, "the tip of the array folds: h is {value:.3g} (normal above {bound:.3g})", "retract, and look where the stylet is; `resume` is possible if guidance.tip_fold is \"pause\""),
    Condition.TIP_FOLD_WARNING: Row(Reaction.NOTE, "the tip of the array may fold: h is {value:.3g} (normal above {bound:.3g})", "pause the insertion, and look where the stylet is"),
    Condition.DETECTOR_BLIND: Row(Reaction.NOTE, "the detectors cannot watch this insertion: at {value:.3g} mm no force is known from {bound:.3g} mm on", "insert from the entry, unbiased, if you want it watched"),
    Condition.IMPEDANCE_SILENT: Row(Reaction.NOTE, "impedance guidance stands still: no valid sample for {value:.0f} ticks (limit {bound:.0f})", "check the implant's telemetry; the plan goes on without it"),
    Condition.IMPEDANCE_UNUSABLE: Row(Reaction.NOTE, "impedance guidance stands still: {value:.0f} pairs can be used (at least {bound:.0f}); the others are stale, open, shorted or noisy", "look for air in the cochlea and for broken leads; the plan goes on without it"),
    Condition.IMPEDANCE_LOST: Row(Reaction.PAUSE, "impedance guidance is blind ({value:.0f}, bound {bound:.0f}), and impedance.when_blind is \"pause\"", "bring the telemetry back or set impedance.guidance to false, then resume; or retract"),
    Condition.DEVICE_WARNING: Row(Reaction.NOTE, "a device reports a trouble", "see the table of troubles"),
    Condition.DEVICE_PAUSE: Row(Reaction.PAUSE, "a device asks for a pause", "see the table of troubles, then resume or retract"),
    Condition.DEVICE_FAULT: Row(Reaction.FAULT, "a device cannot go on", "see the table of troubles, then acknowledge"),
    Condition.FORCE_DRIFT: Row(Reaction.NOTE, "the sensor feels {value:.3g} N with the array outside the cochlea (limit {bound:.3g})", "see that nothing touches the array; then the gauges have drifted: run `rtctl unbias`"),
    Condition.OVERRUN_PERSISTENT: Row(Reaction.PAUSE, "the loop missed {value:.0f} ticks of the window safety.overrun_window_s (limit {bound:.0f})", "relieve the machine (see docs/how-to/bring-up-a-target-pc.md); when a whole window has passed well, resume"),
    Condition.OVERRUN_UNABATED: Row(Reaction.FAULT, "the loop missed too many ticks in {value:.0f} windows in a row (limit {bound:.0f})", "relieve the machine (see docs/how-to/bring-up-a-target-pc.md), then acknowledge"),
    Condition.DEVICE_CLOCK: Row(Reaction.NOTE, "the time of the device that paces the loop cannot be true, so the grid is held as it is", "look at the device; the loop follows it again after a second of plausible time"),
}  # fmt: skip
DEVICE_CONDITIONS = (Condition.DEVICE_WARNING, Condition.DEVICE_PAUSE, Condition.DEVICE_FAULT)
"""Their value is the code of a :class:`hal.troubles.Trouble`, whose own row has the text; their bound its number."""


def mask(reaction: Reaction) -> int:
    """Bits of all conditions with `reaction`."""
    return sum(1 << c for c, row in TABLE.items() if row.reaction is reaction)


FAULT_MASK, PAUSE_MASK, STOP_MASK = mask(Reaction.FAULT), mask(Reaction.PAUSE), mask(Reaction.STOP)
REACTION = np.array([TABLE[c].reaction for c in Condition])

NEVER_BLOCK_RETRACTION = (
    Condition.FORCE_LIMIT,
    Condition.WRENCH_LOST,
    Condition.ADMITTANCE_SATURATED,
    Condition.LOG_FAILED,
    Condition.BUCKLING,
    Condition.TIP_FOLD,
    Condition.IMPEDANCE_LOST,
    Condition.DEVICE_PAUSE,
)
"""The way out must stay open: these conditions neither pause nor refuse a retraction."""
WARNINGS = (
    Condition.BUCKLING_WARNING,
    Condition.TIP_FOLD_WARNING,
    Condition.DETECTOR_BLIND,
    Condition.IMPEDANCE_SILENT,
    Condition.IMPEDANCE_UNUSABLE,
    Condition.DEVICE_WARNING,
    Condition.FORCE_DRIFT,
    Condition.DEVICE_CLOCK,
)
"""Notes that the operator should see at once."""
RETRACTION_MASK = PAUSE_MASK & ~sum(1 << c for c in NEVER_BLOCK_RETRACTION)


@kernel
def permits(state, verb):
    """True if `verb` makes sense in operating `state`; what else it needs is judged by who carries it out."""
    if verb == Verb.STOP or verb == Verb.DISABLE or verb == Verb.SET_PARAMETERS or verb == Verb.UNLOAD_ARRAY:
        return True
    if verb == Verb.ENABLE:
        return state == Operating.DISABLED or state == Operating.ENABLED
    if verb == Verb.PAUSE:
        return state == Operating.ENABLED or state == Operating.PAUSED
    if verb == Verb.RESUME:
        return state == Operating.PAUSED
    if verb == Verb.ACKNOWLEDGE:
        return state == Operating.FAULT
    if verb == Verb.LOAD_PLAN:
        return state != Operating.FAULT
    if verb == Verb.RETRACT:  # out of a paused insertion, too
        return state == Operating.ENABLED or state == Operating.PAUSED
    return state == Operating.ENABLED  # motion and its preparations


@kernel
def step(state, active, verb, retracting):
    """One step of the machine: (operating state, active condition bits, verb) -> (state, verdict).

    `retracting` tells that a retraction is under way. Conditions come before the verb: a fault in the tick of an
    enable leaves FAULT, and a pausing condition refuses what it would pause at once, so that nothing ever begins to
    move in PAUSED. The verdict is a Reason, 0 without a verb, and ACCEPTED also for verbs that do not change the state.
    """
    if verb == Verb.NONE:
        verdict = 0
    elif permits(state, verb):
        verdict = Reason.ACCEPTED
    else:
        verdict = Reason.WRONG_STATE
    if active & FAULT_MASK:
        if verb == Verb.ACKNOWLEDGE and state == Operating.FAULT:
            verdict = Reason.STILL_PRESENT
        elif (
            verb != Verb.NONE
            and verb != Verb.STOP
            and verb != Verb.DISABLE
            and verb != Verb.SET_PARAMETERS
            and verb != Verb.UNLOAD_ARRAY
        ):
            verdict = Reason.WRONG_STATE
        return Operating.FAULT, verdict
    pausing = active & (RETRACTION_MASK if retracting or verb == Verb.RETRACT else PAUSE_MASK)
    if verdict == Reason.ACCEPTED:
        if verb == Verb.ENABLE:
            state = Operating.ENABLED
        elif verb == Verb.ACKNOWLEDGE or (verb == Verb.DISABLE and state != Operating.FAULT):
            state = Operating.DISABLED
        elif verb == Verb.PAUSE:
            state = Operating.PAUSED
        elif verb == Verb.RESUME or verb == Verb.RETRACT:
            if pausing:
                return Operating.PAUSED, Reason.STILL_PRESENT
            state = Operating.ENABLED
    if state == Operating.ENABLED and pausing:
        if verdict == Reason.ACCEPTED and verb != Verb.ENABLE and not permits(Operating.PAUSED, verb):
            verdict = Reason.STILL_PRESENT
        return Operating.PAUSED, verdict
    return state, verdict
