"""What the threads of the gateway share."""

import time
from dataclasses import dataclass, field
from queue import SimpleQueue
from threading import Lock
from typing import Any

from rtctl.exchange.control import LOG_WRITING, Word, get, put
from rtctl.exchange.segment import Segment
from rtctl.gateway.commander import Commander
from rtctl.gateway.events import Event, Watcher
from rtctl.gateway.journal import Journal
from rtctl.gateway.lease import Lease
from rtctl.gateway.parameters import Parameters
from rtctl.gateway.scopes import Scopes
from rtctl.robots import Robot
from rtctl.settings import Settings


@dataclass
class Run:
    """One run of the controller, seen from the gateway."""

    settings: Settings
    robot: Robot
    segment: Segment
    journal: Journal
    commander: Commander
    lease: Lease
    parameters: Parameters
    watcher: Watcher
    scopes: Scopes
    latest: Any = None
    """newest controller record, replaced as a whole by the thread that drains; None before the first"""
    told: SimpleQueue[Event] = field(default_factory=SimpleQueue)
    """events of other threads, for the one that drains"""
    _health: Lock = field(default_factory=Lock)

    def say_health(self) -> None:
        """Tell the tick how the log and the operator are; from any thread."""
        with self._health:
            logging = 0 if self.journal.failure else LOG_WRITING
            put(self.segment.control, Word.GATEWAY_HEALTH, self.lease.health | logging)

    def word(self, word: Word) -> int:
        """The value of a control word."""
        return int(get(self.segment.control, word))

    def stamp(self) -> tuple[int, int]:
        """(time_ns, tick) of the newest record; the time of day before the first."""
        row = self.latest
        return (time.time_ns(), -1) if row is None else (int(row["time_ns"]), int(row["tick"]))

    def tell(self, kind: str, text: str, remedy: str = "", severity: str = "info") -> None:
        """Add an event to the diary; from any thread."""
        time_ns, tick = self.stamp()
        self.told.put(Event(time_ns=time_ns, tick=tick, kind=kind, text=text, remedy=remedy, severity=severity))
