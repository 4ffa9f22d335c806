"""What clients see of a record: CRTK feedback and the operating state, as plain tables."""

from typing import Any

import numpy as np

from hal.signals import Table
from rtctl.exchange.control import Grade
from rtctl.gateway.events import say
from rtctl.gateway.keys import FEEDBACK
from rtctl.lifecycle import TABLE, Condition, Motion, Operating, Task


class Feedback:
    """Turns records of `table` into the payloads of the feedback keys."""

    def __init__(self, table: Table) -> None:
        signals = {s.name: s for s in table.signals}
        self._meta = {
            key: {"unit": signals[names[0]].unit, "frame": signals[names[0]].frame} for key, names in FEEDBACK.items()
        }

    def payloads(self, row: Any) -> dict[str, dict[str, Any]]:
        """Key -> payload; a number that is not known is null."""
        stamp = {"time_ns": int(row["time_ns"]), "tick": int(row["tick"])}
        return {
            key: {**stamp, **self._meta[key], "values": [v for name in names for v in numbers(row[name])]}
            for key, names in FEEDBACK.items()
        }


def numbers(values: Any) -> list[float | None]:
    """Plain numbers of a field, None where it is not a number."""
    return [float(v) if np.isfinite(v) else None for v in np.atleast_1d(values)]


def operating_state(row: Any, grade: int, holder: str, causes: dict[Condition, tuple[str, str]]) -> dict[str, Any]:
    """CRTK's operating state, with the task, the grade, the writer, and what is wrong and what to do about it."""
    active, latched = int(row["condition_active"]), int(row["condition_latched"])
    state = Operating(int(row["operating_state"]))
    fault = Condition(int(row["fault_cause"])) if state is Operating.FAULT and row["fault_cause"] >= 0 else None
    return {
        "time_ns": int(row["time_ns"]),
        "tick": int(row["tick"]),
        "state": state.name,
        "is_homed": bool(row["is_homed"]),
        "is_busy": bool(row["is_busy"]),
        "task_state": Task(int(row["task_state"])).name.lower(),
        "motion": Motion(int(row["motion"])).name.lower(),
        "grade": Grade(grade).name.lower().replace("_", "-"),
        "lease_holder": holder or None,
        "fault_cause": None if fault is None else condition(fault, causes),
        "conditions": [condition(c, causes) for c in TABLE if active & 1 << c],
        "latched": [c.name.lower() for c in TABLE if latched & 1 << c],
    }


def condition(c: Condition, causes: dict[Condition, tuple[str, str]]) -> dict[str, str]:
    """Name, reaction, text and remedy of a condition, with the numbers it arose with where they are known."""
    text, remedy = causes.get(c) or (say(c), TABLE[c].remedy)
    return {"name": c.name.lower(), "reaction": TABLE[c].reaction.name.lower(), "text": text, "remedy": remedy}
