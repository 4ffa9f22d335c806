"""Who held the loop while it was certified, in the words of its black boxes."""

from collections import Counter
from typing import Any

import numpy as np

from rtctl.daemon import Daemon
from rtctl.gateway.blackbox import BlackBoxes
from rtctl.gateway.witness import Witness

KEPT = 50
"""Of the boxes told in full; all are counted."""
UNEXPLAINED = "not explained"
TOLD = ("tick", "text", "remedy", "causes")


class Boxes:
    """Counts and words of the black boxes of some rounds."""

    def __init__(self) -> None:
        self.causes: Counter[str] = Counter()
        self.left_out = 0
        self._told: list[dict[str, Any]] = []

    def take(self, boxes: list[dict[str, Any]], number: int) -> None:
        """Take note of boxes of round `number`."""
        for box in boxes:
            self.causes[box["causes"][0] if box["causes"] else UNEXPLAINED] += 1
            self._keep([{"round": number, **{name: box[name] for name in TOLD}}])

    def merge(self, other: "Boxes") -> None:
        """Take note of what another round has."""
        self.causes += other.causes
        self.left_out += other.left_out
        self._keep(other._told)

    def _keep(self, told: list[dict[str, Any]]) -> None:
        self._told = (self._told + told)[:KEPT]

    def as_table(self) -> dict[str, Any]:
        """Plain data: boxes by their strongest cause, ticks over budget that have none, and the first boxes in words."""
        return {"causes": dict(self.causes.most_common()), "left_out": self.left_out, "told": self._told}


class Recorder:
    """Does for one run of the loop what the gateway does: watches, and keeps the boxes."""

    def __init__(self, daemon: Daemon, number: int) -> None:
        """number: of the round."""
        segment, period_ns = daemon.segment, round(daemon.settings.loop.period_s * 1e9)
        self._watched = BlackBoxes(segment.records, segment.layout.record, Witness(segment.control), period_ns)
        self._number = number
        self.boxes = Boxes()

    def watch(self, rows: np.ndarray, position: int) -> None:
        """See :meth:`rtctl.gateway.blackbox.BlackBoxes.watch`."""
        self.boxes.take(self._watched.watch(rows, position), self._number)

    def close(self) -> Boxes:
        """All boxes, those too whose ticks after them never came."""
        self.boxes.take(self._watched.freeze(), self._number)
        self.boxes.left_out = self._watched.left_out
        return self.boxes
