"""Every key of the controller, in one table: what can be asked, what is published, and who may.

All keys live below ``rtctl/<robot>/``. A request is a Zenoh query with a JSON payload
(:class:`rtctl.gateway.messages.Request` and its kin); the reply is JSON too.
"""

import enum
from collections.abc import Iterator
from dataclasses import dataclass

from rtctl.commands import Verb

MOTION_OF_POSE = (Verb.MOVE_CP, Verb.SERVO_CP, Verb.SERVO_CV)
ALONG_PATH = (Verb.INSERT, Verb.RETRACT)
STAGED = (Verb.LOAD_PLAN, Verb.SET_PARAMETERS)
"""Verbs the gateway posts itself, after it has staged their data."""

CRTK_STATE_COMMANDS = ("enable", "disable", "pause", "resume", "home")


class Kind(enum.Enum):
    """How a request is handled."""

    VERB = enum.auto()
    STATE_COMMAND = enum.auto()
    PLAN = enum.auto()
    GET = enum.auto()
    SET = enum.auto()
    LIST = enum.auto()
    LEASE = enum.auto()
    STATUS = enum.auto()
    SCOPE_OPEN = enum.auto()
    SCOPE = enum.auto()


@dataclass(frozen=True)
class Key:
    """One key that can be asked."""

    kind: Kind
    doc: str
    verb: Verb = Verb.NONE
    arguments: str = ""
    """what `arguments` must hold, in words"""
    lease: bool = True
    """only the holder of the lease may"""
    urgent: bool = False
    """overtakes every other request"""

    def argument_count(self, dof: int) -> int:
        """How many numbers `arguments` must hold for a robot with `dof` pose coordinates."""
        if self.verb in MOTION_OF_POSE:
            return dof
        return 2 if self.verb in ALONG_PATH else 0


REQUESTS: dict[str, Key] = {
    "state_command": Key(Kind.STATE_COMMAND, "CRTK: `command` is one of " + ", ".join(CRTK_STATE_COMMANDS)),
    "enable": Key(Kind.VERB, "energise the amplifiers and hold", Verb.ENABLE),
    "disable": Key(Kind.VERB, "remove power", Verb.DISABLE),
    "pause": Key(Kind.VERB, "brake, then nothing moves until `resume`", Verb.PAUSE),
    "resume": Key(Kind.VERB, "go on with what was paused", Verb.RESUME),
    "home": Key(Kind.VERB, "find the end stops", Verb.HOME),
    "stop": Key(Kind.VERB, "brake and hold; anybody may", Verb.STOP, lease=False, urgent=True),
    "acknowledge": Key(Kind.VERB, "leave FAULT once its cause is gone", Verb.ACKNOWLEDGE),
    "move_cp": Key(Kind.VERB, "straight to a pose", Verb.MOVE_CP, "pose (dof) [mm, rad]"),
    "servo_cp": Key(Kind.VERB, "stream of poses; silence stops", Verb.SERVO_CP, "pose (dof) [mm, rad]"),
    "servo_cv": Key(Kind.VERB, "stream of velocities; silence stops", Verb.SERVO_CV, "rate (dof) [mm/s, rad/s]"),
    "approach": Key(Kind.VERB, "to the first pose of the plan", Verb.APPROACH),
    "insert": Key(Kind.VERB, "insert along the plan", Verb.INSERT, "depth [mm], speed [mm/s]"),
    "retract": Key(Kind.VERB, "back along the plan", Verb.RETRACT, "depth [mm], speed [mm/s]"),
    "register_entry": Key(Kind.VERB, "the present pose is the entry", Verb.REGISTER_ENTRY),
    "load_array": Key(Kind.VERB, "an array is in the gripper", Verb.LOAD_ARRAY),
    "unload_array": Key(Kind.VERB, "the gripper is empty", Verb.UNLOAD_ARRAY),
    "unbias": Key(Kind.VERB, "the present force is zero", Verb.UNBIAS),
    "plan": Key(Kind.PLAN, "compute and load the plan from the registered entry, or load the document `plan` there"),
    "param/get": Key(Kind.GET, "values of `names`, all without names", lease=False),
    "param/set": Key(Kind.SET, "stage `values` as one set, checked together"),
    "param/list": Key(Kind.LIST, "every option: value, unit, bounds, live or not", lease=False),
    "lease/acquire": Key(Kind.LEASE, "become the one writer", lease=False, urgent=True),
    "lease/renew": Key(Kind.LEASE, "heartbeat of the holder", lease=False, urgent=True),
    "lease/release": Key(Kind.LEASE, "stop being the writer", lease=False, urgent=True),
    "status": Key(Kind.STATUS, "everything an operator wants to see at a glance", lease=False),
    "scope/open": Key(Kind.SCOPE_OPEN, "begin a scope as `setup` says; the reply names it", lease=False),
    "scope/state": Key(Kind.SCOPE, "how far `scope` is; a sign of life of its client", lease=False),
    "scope/force": Key(Kind.SCOPE, "have `scope` fire now", lease=False),
    "scope/read": Key(Kind.SCOPE, "bytes of the next capture of `scope` after `seen`, from `offset` on", lease=False),
    "scope/close": Key(Kind.SCOPE, "end `scope`", lease=False),
}

FEEDBACK: dict[str, tuple[str, ...]] = {
    "measured_js": ("joint_measured", "stylet_measured_mm"),
    "setpoint_js": ("joint_reference", "stylet_reference_mm"),
    "measured_cp": ("pose_measured",),
    "setpoint_cp": ("pose_reference",),
    "goal_cp": ("pose_goal",),
    "measured_cf": ("wrench_in_base",),
}
"""CRTK feedback: key -> the signals of the record whose values it carries, in order."""

PUBLISHED: dict[str, str] = {
    "record": "newest controller record, CDR of the log's message `Controller`, at gateway.state_rate_hz",
    **{key: f"JSON, {' and '.join(signals)} of the record" for key, signals in FEEDBACK.items()},
    "operating_state": "JSON: state, task_state, is_homed, is_busy, grade, cause and more; on change and every second",
    "lease": "JSON: holder or null; on change and every second",
    "events": "JSON: what happened, and what to do about it",
    "alive": "liveliness token of the gateway",
}  # fmt: skip

OPERATOR_TWIST = "operator/twist"
BY_DEVICES: dict[str, str] = {
    OPERATOR_TWIST: "JSON: twist, buttons and deadman of a person who drives by hand, for `rtctl operate follow`",
}
"""What operators' devices publish; the gateway passes it on and reads none of it."""


def key_of(verb: Verb) -> str:
    """The key that asks for `verb`, below ``rtctl/<robot>/``."""
    return verb.name.lower()


def reference() -> Iterator[tuple[str, str, str, str]]:
    """Rows (key, arguments, who may, meaning) of the reference documentation."""
    for name, key in REQUESTS.items():
        yield name, key.arguments, "holder of the lease" if key.lease else "everybody", key.doc
    for name, doc in PUBLISHED.items():
        yield name, "", "published", doc
    for name, doc in BY_DEVICES.items():
        yield name, "", "published by a device", doc
