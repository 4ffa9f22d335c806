"""The bridge: holds the lease and turns what the link lets through into commands, at a fixed rate.

The end of a motion does not depend on it: `servo_cv` is a stream that the controller ends by itself 50 ms after the
last command, along a jerk-limited brake. A `stop` at the end of every stream only makes that sooner.
"""

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import zenoh

from hal.errors import RtctlError
from rtctl.client import Reply
from rtctl.commands import CommandRefused, Verb
from rtctl.lifecycle import Condition, Motion
from rtctl.operator.link import Demand, Link, Loss
from rtctl.operator.message import Button
from rtctl.operator.motion import STAGES, Projection

PERIOD_S = 0.02
VALID_S = 0.05
"""No command takes effect later than this after it was sent, nor after the message behind it is stale."""
FAILURES = (RtctlError, zenoh.ZError)
PATH_VERBS = {Button.INSERT: Verb.INSERT, Button.RETRACT: Verb.RETRACT, Button.RESUME: Verb.RESUME}


class Controller(Protocol):
    """The part of :class:`rtctl.client.Client` a follower needs."""

    def command(self, verb: Verb, *arguments: float, valid_for_s: float = ...) -> Reply:
        """Have the controller do `verb`."""
        ...

    def stop(self) -> Reply:
        """Brake and hold."""
        ...

    def latest(self) -> Any:
        """The newest record, or None."""
        ...


class Follower:
    """Follows the operator of `link`; `tell` is called with lines for whoever watches.

    Args:
        stage: number of the speed stage to begin with, from 0.
        step_mm, path_speed_mm_per_s: one press of INSERT or RETRACT; the speed is that of the last stage.
    """

    def __init__(
        self,
        controller: Controller,
        link: Link,
        projection: Projection,
        tell: Callable[[str], object],
        *,
        stage: int = 1,
        step_mm: float = 0.25,
        path_speed_mm_per_s: float = 0.5,
    ) -> None:
        self._controller, self._link, self._projection, self._tell = controller, link, projection, tell
        self._stage, self._step_mm, self._path_speed_mm_per_s = stage, step_mm, path_speed_mm_per_s
        self._streaming, self._stream_tick = False, 0
        self._due_s = self._wake_s = -np.inf
        self._path_tick: int | None = None
        self._told_dropped = False

    def run(self, ended: Callable[[], bool]) -> None:
        """Follow until `ended()`, then leave nothing moving."""
        try:
            while not ended():
                self._link.news.wait(max(0.0, self._wake_s - time.monotonic()))
                self._link.news.clear()
                self.step(time.monotonic())
        finally:
            self._let_go()

    def step(self, now_s: float) -> None:
        """Do what is to be done at `now_s`."""
        if self._link.take_stop() and self._attempt("stop", self._controller.stop):
            self._streaming, self._path_tick = False, None
        demand = self._link.demand(now_s)
        if demand is None:
            self._let_go()
            self._due_s, self._wake_s = -np.inf, now_s + PERIOD_S
        else:
            self._follow(demand, now_s)
            self._wake_s = min(self._due_s, now_s + demand.left_s)
        for loss, detail in self._link.take_losses():  # last: whoever reads it may be slow
            self._tell(f"{loss.value}: {detail}" if detail else loss.value)

    def _follow(self, demand: Demand, now_s: float) -> None:
        if demand.pressed:
            self._press(demand.pressed)
        elif now_s >= self._due_s:
            self._due_s = now_s + PERIOD_S if now_s - self._due_s > PERIOD_S else self._due_s + PERIOD_S
            if self._path_is_over():
                self._stream(demand)

    def _stream(self, demand: Demand) -> None:
        record = self._controller.latest()
        if record is None:
            return
        if self._streaming and record["tick"] >= self._stream_tick and record["motion"] != Motion.SERVO_CV:
            cause = int(record["stop_cause"])
            self._streaming = False
            self._end(f"it ended the motion ({Condition(cause).name.lower() if cause >= 0 else 'stop'})")
            return
        rate, dropped = self._projection.rate(demand.twist, demand.frame, record["pose_measured"], STAGES[self._stage])
        if dropped and not self._told_dropped:
            self._told_dropped = True
            self._tell("this robot cannot follow all of the twist: what it has no direction for is dropped")
        if not np.isfinite(rate).all():
            self._end("the pose of the gripper is not known: home the robot")
            return
        if not self._streaming and not rate.any():
            return
        try:
            valid_s = min(VALID_S, demand.left_s)
            self._stream_tick = (
                self._controller.command(Verb.SERVO_CV, *map(float, rate), valid_for_s=valid_s).tick or 0
            )
            self._streaming = True  # only now: after a refused one, a `stop` could end an insertion that holds
        except CommandRefused as refused:
            if refused.reason != "expired":  # one that was too late had no effect; the next one is on its way
                self._end(str(refused))
        except FAILURES as error:
            self._end(str(error))

    def _press(self, pressed: Button) -> None:
        for button, by in ((Button.SLOWER, -1), (Button.FASTER, 1)):
            if button in pressed:
                self._stage = min(max(self._stage + by, 0), len(STAGES) - 1)
                self._tell(f"speed stage {self._stage + 1} of {len(STAGES)}, {STAGES[self._stage]:.0%}")
        for button, verb in PATH_VERBS.items():
            if button in pressed:
                self._let_go()
                self._begin_on_path(verb)
                return

    def _begin_on_path(self, verb: Verb) -> None:
        arguments: tuple[float, ...] = ()
        record = self._controller.latest()
        if record is None:
            return
        if verb != Verb.RESUME:
            depth_mm = float(record["depth_mm"]) + (self._step_mm if verb == Verb.INSERT else -self._step_mm)
            arguments = max(depth_mm, 0.0), self._path_speed_mm_per_s * STAGES[self._stage]
        try:
            self._path_tick = self._controller.command(verb, *arguments, valid_for_s=VALID_S).tick
        except FAILURES as error:
            self._end(str(error))

    def _path_is_over(self) -> bool:
        """No step along the path is under way, as far as the newest record knows."""
        if self._path_tick is not None:
            record = self._controller.latest()
            if record["tick"] >= self._path_tick and not record["is_busy"]:
                self._path_tick = None
        return self._path_tick is None

    def _let_go(self) -> None:
        """End what moves at our command."""
        if self._streaming:
            self._streaming = False
            self._attempt("stop", self._controller.stop)
        if not self._path_is_over():
            self._path_tick = None
            self._attempt("pause", lambda: self._controller.command(Verb.PAUSE))

    def _end(self, why: str) -> None:
        self._link.end(Loss.REFUSED, why)
        self._let_go()

    def _attempt(self, what: str, action: Callable[[], object]) -> bool:
        try:
            action()
        except FAILURES as error:
            self._tell(f"{what} was not confirmed ({error}); the controller stops by itself when the stream ends")
            return False
        return True
