"""A scope in a running controller, seen from a script or a notebook.

with robot.scope(["force_axial_n"], trigger="force_axial_n < -0.02", edge="falling", pre=200) as scope:
    capture = scope.wait()
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import msgspec
import numpy as np
import zenoh

from hal.errors import RtctlError
from hal.signals import Signal
from rtctl.commands import CommandRefused
from rtctl.scope.capture import Capture
from rtctl.scope.probe import row_dtype
from rtctl.scope.scope import State
from rtctl.scope.setup import Setup

if TYPE_CHECKING:
    from rtctl.client import Reply

POLL_S = 0.05
SILENCE_S = 4.0
"""So long nobody needs to answer: longer than a busy gateway is silent, shorter than it keeps a scope."""

Ask = Callable[[str, dict[str, Any]], "Reply"]


class ScopeEnded(RtctlError):
    """The scope is gone before its captures were finished."""

    exit_code = 3


class NoCapture(RtctlError):
    """The trigger did not come in time."""


class Progress(NamedTuple):
    """How far a scope is: its state, samples the present capture has, captures finished."""

    state: State
    filled: int
    finished: int


class RemoteScope:
    """Opened by :meth:`rtctl.client.Client.scope`; a context manager, and an iterator over its captures.

    A thread keeps it alive and fetches what is finished. Leaving the context, or :meth:`stop`, ends it.

    Raises:
        CommandRefused: the controller does not accept the setup, or has no room for another scope.
        NoReply: nobody answered.
    """

    def __init__(self, ask: Ask, setup: Setup) -> None:
        self.setup, self._ask = setup, ask
        opened = ask("scope/open", {"setup": msgspec.to_builtins(setup)}).result
        self.signals = msgspec.convert(opened["signals"], tuple[Signal, ...])
        self._token, self._dtype = str(opened["scope"]), row_dtype(self.signals)
        self._fetched: deque[Capture] = deque()
        self._seen = 0
        self._error: RtctlError | None = None
        self._news = threading.Condition()
        self._ending = threading.Event()
        self.progress = Progress(State(opened["state"]), 0, 0)
        self._thread = threading.Thread(target=self._follow, name="scope", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.stop()

    def __iter__(self) -> Iterator[Capture]:
        """All captures of the setup, as they are finished."""
        for _ in range(self.setup.captures):
            yield self.wait()

    def wait(self, timeout_s: float | None = None) -> Capture:
        """The next capture.

        Raises:
            NoCapture: it was not finished within `timeout_s` seconds.
            ScopeEnded: the scope was stopped, the controller is gone, or there is no further capture.
        """
        with self._news:
            if not self._news.wait_for(lambda: self._fetched or self._error or self._ending.is_set(), timeout_s):
                text = f"no capture: the scope is {self.progress.state}, for {self.setup.trigger}"
                raise NoCapture(text, bound=f"within {timeout_s:g} s", remedy="wait longer, or force it")
            if self._fetched:
                return self._fetched.popleft()
            raise self._error or ScopeEnded("the scope has been stopped, or all its captures were taken")

    def force(self) -> None:
        """Fire now, or as soon as the samples before the trigger are there.

        Raises:
            CommandRefused: the scope is gone.
            NoReply: nobody answered.
        """
        self._ask("scope/force", {"scope": self._token, "seen": self._seen})

    def stop(self) -> None:
        """End the scope; captures that were fetched can still be taken."""
        if self._ending.is_set():
            return
        self._end(None)
        self._thread.join(SILENCE_S)
        with contextlib.suppress(RtctlError, zenoh.ZError):  # it dies of silence
            self._ask("scope/close", {"scope": self._token, "seen": self._seen})

    def _follow(self) -> None:
        heard_s = time.monotonic()
        while not self._ending.wait(POLL_S):
            try:
                self._poll()
                heard_s = time.monotonic()
            except CommandRefused as refused:
                if refused.reason not in ("overloaded", "expired"):  # these may be better next time
                    self._end(ScopeEnded(f"the scope has ended: {refused.what}", remedy=refused.remedy))
            except (RtctlError, zenoh.ZError) as error:
                if time.monotonic() - heard_s > SILENCE_S:
                    remedy = "look at `rtctl status`; what happened until then is in the log: `rtctl scope --log`"
                    self._end(ScopeEnded(f"the scope has ended: the controller fell silent ({error})", remedy=remedy))
            except Exception as error:  # whoever waits must be told, whatever was in a reply
                self._end(ScopeEnded(f"the scope has ended: a reply was not understood ({error!r})"))

    def _poll(self) -> None:
        told = self._ask("scope/state", {"scope": self._token, "seen": self._seen}).result
        self.progress = Progress(State(told["state"]), int(told["filled"]), int(told["finished"]))
        while self._seen < self.progress.finished and not self._ending.is_set():
            capture = self._fetch()
            self._seen += 1
            with self._news:
                self._fetched.append(capture)
                self._news.notify_all()
        if self._seen == self.setup.captures:
            with contextlib.suppress(RtctlError, zenoh.ZError):  # nobody waits for it any more
                self._ask("scope/close", {"scope": self._token, "seen": self._seen})
            self._end(None)

    def _fetch(self) -> Capture:
        """The oldest capture not seen yet, in as many pieces as the gateway makes of it."""
        data, size, facts = bytearray(), 1, {}
        while len(data) < size:
            reply = self._ask("scope/read", {"scope": self._token, "seen": self._seen, "offset": len(data)})
            size, facts = int(reply.result["size"]), reply.result["facts"]
            if not reply.data:
                raise ValueError("an empty piece of a capture")
            data += reply.data
        return Capture(rows=np.frombuffer(data, self._dtype), signals=self.signals, **facts)

    def _end(self, error: RtctlError | None) -> None:
        with self._news:
            self._error = error
            self._ending.set()
            self._news.notify_all()
