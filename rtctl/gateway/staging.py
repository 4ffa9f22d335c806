"""Plans and parameter sets on their way to the tick: into the log, into a slot, and only then the command."""

from typing import Any

import numpy as np

from rtctl.exchange.mailbox import stage
from rtctl.gateway.journal import Journal, with_bytes
from rtctl.gateway.refusal import Refusal

NUMBER = 1
"""Column of a staging slot that holds the number of its payload."""


def next_number(slots: np.ndarray, in_force: int) -> int:
    """A number no payload of this run has had, also after a restart of the gateway."""
    return max(int(slots[:, NUMBER].max()), in_force) + 1


def log_and_stage(
    journal: Journal, topic: str, time_ns: int, content: dict[str, Any], slots: np.ndarray, record: np.ndarray
) -> int:
    """Log `record` (1,) bit for bit and safely, stage it, and return its slot.

    Raises:
        Refusal: the log cannot be written, so nothing new may take effect.
    """
    if not (journal.document(topic, time_ns, with_bytes(content, record)) and journal.flush()):
        text = f"the log cannot be written: {journal.failure}"
        raise Refusal("log_failed", text, "free space on the disk of the log and restart")
    return int(stage(slots, int(record[0]["number"]), record[0]))
