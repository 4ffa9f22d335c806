"""Driving with the keys of a terminal.

A terminal does not tell when a key is let go. What it tells is that a held key repeats, so here the deadman is the
freshness of that repetition: it is held for :data:`HOLD_S` after each arrival of a key, and then not any more. A tap is
a nudge of that length; a key that is held moves, rests until the terminal begins to repeat it, and moves on.
"""

import os
import select
import termios
import tty
from types import TracebackType
from typing import Self

from hal.errors import RtctlError
from rtctl.operator.message import Button
from rtctl.operator.publisher import Sample, Twist

HOLD_S = 0.12
"""Longer than the slowest usual repetition (92 ms on the Linux console)."""
ESCAPE = b"\x1b"

MOTION: dict[bytes, tuple[int, float]] = {
    b"w": (0, 1.0), b"s": (0, -1.0), b"a": (1, 1.0), b"d": (1, -1.0), b"r": (2, 1.0), b"f": (2, -1.0),
    b"q": (5, 1.0), b"e": (5, -1.0),
}  # fmt: skip
"""Key -> component of the twist, and its sign."""
BUTTONS: dict[bytes, Button] = {b" ": Button.STOP, b"-": Button.SLOWER, b"+": Button.FASTER}
HELP = "w s forwards, backwards; a d left, right; q e turn; r f up, down; + - speed; space stops; Ctrl-C ends"


class KeyboardError(RtctlError):
    """There is no terminal to read keys from."""

    exit_code = 3


class Keyboard:
    """A device of :mod:`rtctl.operator.publisher` that reads the terminal `fd`; a context manager that puts it back.

    Args:
        speed_mm_per_s, speed_rad_per_s: what a key asks for.

    Raises:
        KeyboardError: `fd` is no terminal.
    """

    def __init__(self, fd: int, speed_mm_per_s: float, speed_rad_per_s: float) -> None:
        self._fd, self._speeds = fd, (speed_mm_per_s, speed_rad_per_s)
        try:
            self._before = termios.tcgetattr(fd)
        except termios.error:
            raise KeyboardError("not a terminal", remedy="run it in a terminal, its input not redirected") from None
        self._sample, self._arrived_s = Sample(), -HOLD_S

    def __enter__(self) -> Self:
        tty.setcbreak(self._fd)
        quiet = termios.tcgetattr(self._fd)
        quiet[6][termios.VSUSP] = b"\0"  # a suspended program could not put the terminal back
        termios.tcsetattr(self._fd, termios.TCSAFLUSH, quiet)  # what was typed before is not meant for the robot
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        termios.tcsetattr(self._fd, termios.TCSAFLUSH, self._before)

    def sample(self, now_s: float) -> Sample | None:
        """See :class:`rtctl.operator.publisher.Device`; an unknown key releases the deadman."""
        if select.select([self._fd], [], [], 0.0)[0]:
            keys = self._read()
            if keys == b"":
                return None
            self._sample, self._arrived_s = self._meaning(keys), now_s
        return self._sample if now_s - self._arrived_s < HOLD_S else Sample()

    def wait(self, timeout_s: float) -> None:
        """Until a key arrives."""
        select.select([self._fd], [], [], timeout_s)

    def _read(self) -> bytes:
        """Keys that arrived; none at the end of the terminal."""
        try:
            return os.read(self._fd, 4096)
        except OSError:  # the other side of the terminal is closed
            return b""

    def _meaning(self, keys: bytes) -> Sample:
        """What was typed; of several keys at once the last counts, but a stop among them always."""
        if b" " in keys:
            return Sample(buttons=Button.STOP)
        key = keys[-1:]
        if ESCAPE in keys:  # a cursor or function key: its letters are not meant
            return Sample()
        if key in BUTTONS:
            return Sample(buttons=BUTTONS[key], deadman=True)
        if key not in MOTION:
            return Sample()
        component, sign = MOTION[key]
        value = sign * self._speeds[component // 3]
        twist: Twist = tuple(value if i == component else 0.0 for i in range(6))  # type: ignore[assignment]
        return Sample(twist, deadman=True)
