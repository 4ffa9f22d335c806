"""What the loop does while it is measured: a simulated robot moves, hardware stays without power."""

from collections.abc import Callable
from typing import Any

import numpy as np

from rtctl.commands import CommandRefused, Verb
from rtctl.lifecycle import Operating
from rtctl.readiness.direct import RunError
from rtctl.settings import Settings
from rtctl.workflow import Operator, Predicate

MOVING = "enabled, homed, and moved to and fro"
STILL = "without power; nothing moves"
START_S = 10.0
"""Time the first record may take."""
REST_S = 1.0
"""For the cause of an interruption to pass; if it has not, the next command is refused, and we come back."""
RECOVERY: dict[Operating, tuple[Verb, ...]] = {
    Operating.ENABLED: (),
    Operating.PAUSED: (Verb.RESUME,),
    Operating.FAULT: (Verb.ACKNOWLEDGE, Verb.ENABLE),
    Operating.DISABLED: (Verb.ENABLE,),
}
"""What ends an interruption: a machine that stalls pauses a motion or trips the watchdog."""


def operate(operator: Operator, settings: Settings, seconds: float, moving: bool) -> None:
    """Let `seconds` of the loop's time pass: moving, or at rest without power.

    Raises:
        RunError: the loop ended before.
    """
    first = operator.wait(lambda record: record is not None, START_S)
    if first is None:
        raise RunError("no record arrived", bound=f"within {START_S:g} s", remedy="see the messages above")
    watch = _Watch(operator, int(first["time_ns"]) + round(seconds * 1e9), seconds + START_S)
    if not moving:
        watch.until(lambda _: False)
        return
    _do(watch, Verb.ENABLE, (), lambda r: r["powered"] or r["operating_state"] != Operating.ENABLED)
    flow = settings.workflow
    entry, aside = np.array(flow.entry_pose_mm_rad), np.array(flow.retracted_pose_mm_rad)
    ends, moves = (aside, 0.5 * (aside + entry)), 0
    while not watch.over:
        if not watch.newest["is_homed"]:
            _do(watch, Verb.HOME, (), _is_at_rest)
        else:
            moves += _do(watch, Verb.MOVE_CP, tuple(map(float, ends[moves % 2])), _is_at_rest)


def _is_at_rest(record: Any) -> bool:
    return not record["is_busy"]


def _do(watch: "_Watch", verb: Verb, arguments: tuple[float, ...], ended: Predicate) -> bool:
    """Give a command and wait for its end; whether that came undisturbed. What stands in its way is dealt with."""
    try:
        tick = watch.operator.command(verb, *arguments)
        watch.until(lambda r: r["tick"] > tick and ended(r))
        if watch.over or watch.newest["operating_state"] == Operating.ENABLED:
            return True
    except CommandRefused:
        pass
    watch.pause(REST_S)
    for remedy in RECOVERY[Operating(int(watch.newest["operating_state"]))]:
        try:
            watch.operator.command(remedy)
        except CommandRefused:
            break
    return False


class _Watch:
    """Waits, but not beyond `end_ns` of the loop's time, and never for a loop that stands still."""

    def __init__(self, operator: Operator, end_ns: int, limit_s: float) -> None:
        self.operator, self._end_ns, self._limit_s = operator, end_ns, limit_s
        self.newest: Any = operator.wait(lambda _: True, 0.0)

    @property
    def over(self) -> bool:
        """The time is over."""
        return int(self.newest["time_ns"]) >= self._end_ns

    def pause(self, seconds: float) -> None:
        """Wait for a while."""
        end_ns = int(self.newest["time_ns"]) + round(seconds * 1e9)
        self.until(lambda r: r["time_ns"] >= end_ns)

    def until(self, done: Callable[[Any], bool]) -> None:
        """Wait for `done` or the end. Raises RunError if the loop ended, or takes much longer than its own time says."""
        self.newest = self.operator.wait(lambda r: r["time_ns"] >= self._end_ns or done(r), self._limit_s)
        if not self.over and not done(self.newest):
            raise RunError("the loop ended, or stood still, while it was measured", value=f"tick {self.newest['tick']}", remedy="see the messages above")  # fmt: skip
