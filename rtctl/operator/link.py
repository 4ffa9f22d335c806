"""The deadman: it counts while it is level and fresh, and is never latched.

Whatever goes wrong ends the motion at once, and from then on the deadman must be seen released before it counts
again: nobody who holds it, or whose hand is stuck on it, starts a motion by what a network does (07 section 5).
"""

import enum
import threading
from dataclasses import dataclass

import numpy as np

from rtctl.operator.message import ALL_BUTTONS, NO_BUTTON, Button, Frame, MessageError, OperatorMessage, decode

FUTURE_S = 0.02
"""A time stamp may be ahead by this much: clocks of two machines are not equal. Less than any age limit."""
FORGET_S = 0.3
"""A source that was silent for this time may be followed by another one, or by itself started anew."""


class Loss(enum.Enum):
    """Why the deadman does not count any more, in words for the operator."""

    RELEASED = "deadman released"
    STALE = "the operator's messages stopped coming"
    LATE = "a message arrived too old: look at the network, and synchronise the clocks of the two machines"
    CLOCK = "a message from the future: synchronise the clocks of the two machines"
    ORDER = "a sequence number did not rise: does another sender use the same source name?"
    SOURCE = "messages of a second source: stop one of the two devices"
    MALFORMED = "a message that is none"
    STOPPED = "stop pressed"
    REFUSED = "the controller did not follow"


@dataclass(frozen=True)
class Demand:
    """What an operator with a counting deadman wants."""

    twist: np.ndarray
    """(6,) vx, vy, vz [mm/s], wx, wy, wz [rad/s] along the axes of `frame`"""
    frame: Frame
    pressed: Button
    """buttons that went down since the last demand; STOP is never among them"""
    left_s: float
    """until the message is stale"""


class Link:
    """Judges every message as it arrives. Safe to call from several threads; times are of a clock that never jumps.

    Args:
        age_limit_s: a message older than this does not count; 0.05 to 0.1 s (07 section 7).

    Attributes:
        news: set when something must be acted upon before the next period.
    """

    def __init__(self, age_limit_s: float) -> None:
        self.age_limit_s = age_limit_s
        self.news = threading.Event()
        self._lock = threading.Lock()
        self._message: OperatorMessage | None = None
        self._born_s = self._heard_s = -np.inf
        self._buttons = ALL_BUTTONS  # what is down in the first message of a source was not pressed for us
        self._armed = False
        self._pressed = NO_BUTTON
        self._stop_level = self._stop_wanted = False
        self._losses: list[tuple[Loss, str]] = []
        self._told: set[Loss] = set()

    def receive(self, payload: bytes, now_s: float, unix_ns: int) -> None:
        """Take the message that arrived at `now_s`, which is Unix time `unix_ns`; whatever is in it, it never raises."""
        with self._lock:
            if self._message is not None and now_s - self._born_s >= self.age_limit_s:
                self._end(Loss.STALE)
            try:
                message = decode(payload)
            except MessageError as error:
                self._end(Loss.MALFORMED, str(error))
                return
            self._look_for_stop(message)
            transit_s = (unix_ns - message.timestamp_ns) / 1e9
            loss = self._objection(message, now_s, transit_s)
            if loss is not None:
                self._end(loss)
                return
            self._take(message, now_s, transit_s)

    def demand(self, now_s: float) -> Demand | None:
        """What the operator wants, None while the deadman does not count; takes the pressed buttons."""
        with self._lock:
            if not self._counts:
                return None
            message, age_s = self._message, now_s - self._born_s
            assert message is not None
            if age_s >= self.age_limit_s:
                self._end(Loss.STALE)
                return None
            pressed, self._pressed = self._pressed, NO_BUTTON
            return Demand(np.array(message.twist), message.frame, pressed, self.age_limit_s - age_s)

    def end(self, loss: Loss, detail: str = "") -> None:
        """The deadman counts no more, until it was seen released."""
        with self._lock:
            self._end(loss, detail)

    def take_stop(self) -> bool:
        """True once for every press of STOP."""
        with self._lock:
            wanted, self._stop_wanted = self._stop_wanted, False
            return wanted

    def take_losses(self) -> list[tuple[Loss, str]]:
        """Losses since the last call, each with its details; the same one over and over comes once."""
        with self._lock:
            losses, self._losses = self._losses, []
            return losses

    @property
    def _counts(self) -> bool:
        return self._armed and self._message is not None and self._message.deadman

    def _look_for_stop(self, message: OperatorMessage) -> None:
        """STOP acts whoever sends it, however late, in whatever order."""
        level = bool(message.buttons & Button.STOP)
        if level and not self._stop_level:
            self._stop_wanted = True
            self.news.set()
        self._stop_level = level

    def _objection(self, message: OperatorMessage, now_s: float, transit_s: float) -> Loss | None:
        """What speaks against believing a well-formed message."""
        last = self._message
        if last is not None and now_s - self._heard_s < FORGET_S:
            if message.source != last.source:
                return Loss.SOURCE
            if message.sequence <= last.sequence:
                return Loss.ORDER
        if transit_s < -FUTURE_S:
            return Loss.CLOCK
        return Loss.LATE if transit_s >= self.age_limit_s else None

    def _take(self, message: OperatorMessage, now_s: float, transit_s: float) -> None:
        last, counted = self._message, self._counts
        if last is None or message.source != last.source or message.sequence <= last.sequence:
            self._armed, self._buttons, counted = False, ALL_BUTTONS, False
        rising = Button(message.buttons & ~self._buttons)
        self._message, self._buttons = message, message.buttons
        self._born_s, self._heard_s = now_s - max(transit_s, 0.0), now_s
        if message.buttons & Button.STOP:
            self._end(Loss.STOPPED)
        elif not message.deadman:
            self._armed, self._pressed = True, NO_BUTTON
            if counted:
                self._losses.append((Loss.RELEASED, ""))
                self.news.set()
        elif self._armed:
            self._pressed |= rising
            if not counted:
                self._told.clear()
            if rising or not counted:
                self.news.set()

    def _end(self, loss: Loss, detail: str = "") -> None:
        if self._counts or loss not in self._told | {Loss.STALE}:  # nobody misses what did not count
            self._losses.append((loss, detail))
            self._told.add(loss)
            self.news.set()
        self._armed, self._pressed = False, NO_BUTTON
