"""What happened, read off consecutive records: the operator's diary, on the wire and in the log."""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from hal import troubles
from rtctl.commands import Reason, Verb, explain
from rtctl.lifecycle import DEVICE_CONDITIONS, TABLE, WARNINGS, Condition, Operating, Reaction, Task

STREAMED = (Verb.SERVO_CP, Verb.SERVO_CV)
"""Verbs that come a hundred times a second: only their refusals are news."""


class Event(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line of the diary."""

    time_ns: int
    tick: int
    kind: str
    """state, task, condition, command, records, log, lease, parameters, plan, process or timing"""
    severity: str = "info"
    """info, warning or error"""
    text: str
    remedy: str = ""
    value: float | None = None
    bound: float | None = None
    blackbox: int | None = None
    """tick by which its black box is found, if it has one"""
    last: dict[str, list] | None = None
    """of a fault: signal -> its values in the last ticks, up to this one"""


class Watcher:
    """Compares every record with the one before it.

    devices: names of the backend's devices in their order, for the troubles they report.
    `causes` keeps the text of every condition since it arose, with the numbers it arose with.
    """

    def __init__(self, devices: Sequence[str] = ()) -> None:
        self.devices = tuple(devices)
        self.causes: dict[Condition, tuple[str, str]] = {}
        self._last: Any = None

    def watch(self, rows: np.ndarray) -> list[Event]:
        """Events of the controller records `rows` (n,), in order."""
        return [event for row in rows[self._interesting(rows)] for event in self._compare(row)]

    def _interesting(self, rows: np.ndarray) -> np.ndarray:
        """Which rows differ from their predecessor in anything that makes an event."""
        news = rows["command_sequence"] != 0
        for name in ("operating_state", "task_state", "condition_active", "trouble", "trouble_device"):
            values = rows[name]
            news[1:] |= values[1:] != values[:-1]
            if len(rows):
                news[0] |= self._last is None or values[0] != self._last[name]
        return news

    def _compare(self, row: Any) -> list[Event]:
        last, self._last = self._last, row.copy()
        active = int(last["condition_active"]) if last is not None else 0
        events = [*self._conditions(row, active), *self._troubles(row, last, active)]
        if row["command_sequence"] != 0:
            events += self._command(row)
        for kind, name, words in (("state", "operating_state", Operating), ("task", "task_state", Task)):
            if last is None or row[name] != last[name]:
                now = words(int(row[name])).name.lower()
                before = "" if last is None else f" (was {words(int(last[name])).name.lower()})"
                severity = "error" if kind == "state" and row[name] == Operating.FAULT else "info"
                events.append(self._event(row, kind, f"{kind} is {now}{before}", severity=severity))
        return events

    def _conditions(self, row: Any, before: int) -> list[Event]:
        events = []
        active = int(row["condition_active"])
        for condition, entry in TABLE.items():
            bit = 1 << condition
            if active & bit and not before & bit:
                reported = row["condition_reported"] == condition
                value, bound = (float(row[f"condition_{n}"]) if reported else np.nan for n in ("value", "bound"))
                text, remedy = self._told(condition, row, value, bound)
                self.causes[condition] = text, remedy
                severity = "info" if entry.reaction is Reaction.NOTE else "error"
                if entry.reaction is Reaction.STOP or condition in WARNINGS:
                    severity = "warning"
                events.append(self._event(row, "condition", text, remedy, severity, _number(value), _number(bound)))
            elif before & bit and not active & bit:
                events.append(self._event(row, "condition", f"over: {_label(condition)}"))
        return events

    def _troubles(self, row: Any, last: Any, before: int) -> list[Event]:
        """A trouble that follows another one, while their condition goes on."""
        if not row["trouble"] or last is None:
            return []
        if row["trouble"] == last["trouble"] and row["trouble_device"] == last["trouble_device"]:
            return []
        for condition in DEVICE_CONDITIONS:
            if int(row["condition_active"]) & before & 1 << condition:
                value, bound = float(row["trouble"]), float(row["trouble_value"])
                text, remedy = self._told(condition, row, value, bound)
                severity = "warning" if condition in WARNINGS else "error"
                return [self._event(row, "condition", text, remedy, severity, value, _number(bound))]
        return []

    def _told(self, condition: Condition, row: Any, value: float, bound: float) -> tuple[str, str]:
        """Text and remedy of a condition that arose; those of a device come from the table of troubles."""
        text, remedy = say(condition, value, bound), TABLE[condition].remedy
        if condition not in DEVICE_CONDITIONS or not row["trouble"]:
            return text, remedy
        number = int(row["trouble_device"])
        name = self.devices[number] if 0 <= number < len(self.devices) else f"device {number}"
        text, remedy = troubles.say(int(row["trouble"]), float(row["trouble_value"]))
        return f"{name}: {text}", remedy

    def _command(self, row: Any) -> list[Event]:
        verb, verdict = int(row["command_verb"]), int(row["command_verdict"])
        name = Verb(verb).name.lower() if verb in Verb._value2member_map_ else f"command number {verb}"
        if verdict in (Reason.NONE, Reason.ACCEPTED):
            return [] if verb in STREAMED else [self._event(row, "command", f"{name} accepted")]
        value, bound = float(row["reason_value"]), float(row["reason_bound"])
        text, remedy = explain(verdict, value, bound)
        text = f"{name} refused: {text}"
        return [self._event(row, "command", text, remedy, "warning", _number(value), _number(bound))]

    def _event(
        self,
        row: Any,
        kind: str,
        text: str,
        remedy: str = "",
        severity: str = "info",
        value: float | None = None,
        bound: float | None = None,
    ) -> Event:
        return Event(
            time_ns=int(row["time_ns"]), tick=int(row["tick"]), kind=kind, severity=severity, text=text, remedy=remedy,
            value=value, bound=bound,
        )  # fmt: skip


def say(condition: Condition, value: float = np.nan, bound: float = np.nan) -> str:
    """Text of a condition with its numbers, its bare name where they are needed but not known."""
    if condition in DEVICE_CONDITIONS and np.isfinite(value):
        return troubles.say(int(value), bound)[0]
    text = TABLE[condition].text
    return text.format(value=value, bound=bound) if np.isfinite(value) or "{" not in text else _label(condition)


def remedy_of(condition: Condition, value: float) -> str:
    """What to do about a condition that arose with `value`."""
    if condition in DEVICE_CONDITIONS and np.isfinite(value):
        return troubles.say(int(value), np.nan)[1]
    return TABLE[condition].remedy


def _label(condition: Condition) -> str:
    return condition.name.lower().replace("_", " ")


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
