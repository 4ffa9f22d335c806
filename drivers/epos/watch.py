"""What is wrong with a bus and its drives, judged every tick; what stops them stays until it is acknowledged (07 section 7)."""

from drivers.epos.axis import Axis
from drivers.epos.link import Link
from drivers.epos.objects import LOST_HEARTBEATS
from drivers.epos.states import State
from hal.device import Readings
from hal.troubles import Trouble

LATE_PERIODS, SILENT_PERIODS = 2, 5
"""Age of a feedback, in periods of the exchange."""
DISOBEYED = 2
"""Feedbacks in a row in which an enabled drive does not follow: the first may still be from before."""
OWED = 3
"""Answers that all drives owe together before the bus is said to be overloaded."""
ENABLED, FAULTY = State.ENABLED, (State.FAULT, State.REACTING)  # the tick has no time to look up enums


class Watch:
    """Latches of one bus.

    What stops the drives is latched while power is asked for. Without power it is what it is at the moment: then there is
    nothing to stop, and what has been mended shall not keep the drives from being armed.

    Attributes:
        latched: what stops the drives, the first cause first, with the number for its text.
    """

    def __init__(self, link: Link, divisor: int, heartbeat_ticks: int) -> None:
        self._link = link
        self._late, self._silent = LATE_PERIODS * divisor, SILENT_PERIODS * divisor
        self._no_beat = LOST_HEARTBEATS * heartbeat_ticks + divisor
        self.latched: dict[Trouble, float] = {}

    def clear(self) -> None:
        """The operator has acknowledged. What is still wrong comes back: bus-off and a reboot last until the next opening."""
        self.latched.clear()
        self._link.forgive()
        for place, axis in enumerate(self._link.axes):
            axis.jump_counts = 0
            self._link.emergency[place] = 0

    def judge(self, tick: int, readings: Readings, power: bool) -> None:
        """Look at everything, latch and report. power: it is asked for."""
        link = self._link
        if not power:
            self.latched.clear()
        if link.off:
            self._latch(Trouble.BUS_OFF, 0.0)
        elif link.unsent and Trouble.BUS_OVERLOAD not in self.latched:
            heard = any(axis.unanswered <= LATE_PERIODS for axis in link.axes)
            self._latch(Trouble.BUS_OVERLOAD if heard else Trouble.BUS_OFF, link.unsent)
        elif self._lags():
            self._latch(Trouble.BUS_OVERLOAD, sum(axis.owed for axis in link.axes) * 2)
        for place, axis in enumerate(link.axes):
            self._judge_axis(tick, place, axis, readings, power)
        for trouble, value in self.latched.items():
            readings.report(trouble, value)
        if link.passive:
            readings.report(Trouble.BUS_PASSIVE)

    def _judge_axis(self, tick: int, place: int, axis: Axis, readings: Readings, power: bool) -> None:
        link, number = self._link, axis.number
        if link.rebooted[place]:
            self._latch(Trouble.NODE_REBOOTED, number)
        age = tick - axis.sampled_tick
        axis.silent = axis.unanswered >= SILENT_PERIODS and age > self._silent
        if axis.silent or (tick - link.beat_tick[place] > self._no_beat and link.exchanges):
            self._latch(Trouble.NODE_SILENT, number)
        elif axis.unanswered >= LATE_PERIODS and age > self._late:
            readings.report(Trouble.NODE_LATE, number)
        if axis.jump_counts:
            self._latch(Trouble.ENCODER_JUMP, axis.jump_counts)
        faulty = axis.state in FAULTY
        if not faulty and not power:
            link.emergency[place] = 0  # the code of a fault that is over
        if faulty or link.emergency[place]:
            if not self.latched.get(Trouble.DRIVE_FAULT):  # the code may come after the statusword
                self.latched[Trouble.DRIVE_FAULT] = link.emergency[place]
        elif axis.disobeyed >= DISOBEYED or (axis.enabled and axis.state is not ENABLED):
            self._latch(Trouble.DRIVE_IGNORES, number)

    def _lags(self) -> bool:
        """All drives owe answers, and yet they are there: it is the bus."""
        return all(axis.owed >= OWED and axis.unanswered <= LATE_PERIODS for axis in self._link.axes)

    def _latch(self, trouble: Trouble, value: float) -> None:
        self.latched.setdefault(trouble, value)
