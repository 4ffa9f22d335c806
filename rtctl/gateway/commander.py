"""Commands into the mailbox, verdicts out of the records."""

import hashlib
import threading
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np

from rtctl.commands import COMMAND, Reason, Verb
from rtctl.exchange.control import RealTimeState, Word, get
from rtctl.exchange.mailbox import POSTED, post
from rtctl.exchange.segment import Segment
from rtctl.gateway.refusal import Refusal, from_verdict

VERDICT_S = 1.0
"""The tick answers in the tick in which it reads; after this time it never will."""


def source_number(source: str) -> int:
    """What the record calls a client: 64 bits of a hash of its name."""
    return int.from_bytes(hashlib.blake2b(source.encode(), digest_size=8).digest(), "little")


class Commander:
    """Posts commands and hands every verdict to whoever waits for it. Safe to call from several threads.

    A command's number is its place in the mailbox, so numbers go on counting over a restart of the gateway.
    """

    def __init__(self, segment: Segment, period_s: float) -> None:
        self._segment, self._period_s = segment, period_s
        self._lock = threading.Lock()
        self._waiting: dict[int, tuple[Future[int], float]] = {}

    def post(
        self, verb: Verb, arguments: Sequence[float], source: str, valid_s: float, now_s: float, slot: int = 0
    ) -> "Future[int]":
        """Queue a command; the future is the tick at which it took effect, or a Refusal.

        Raises:
            Refusal: the loop does not run, or the mailbox is full.
        """
        control = self._segment.control
        if get(control, Word.REAL_TIME_STATE) != RealTimeState.RUNNING:
            raise Refusal("not_running", "the control loop does not run", "look at `rtctl status`")
        future: Future[int] = Future()
        with self._lock:
            command = np.zeros(1, COMMAND)
            number = int(self._segment.mailbox[0, POSTED]) + 1
            command[0]["sequence"] = number
            command[0]["argument"][: len(arguments)] = arguments
            command[0]["deadline_tick"] = get(control, Word.TICK) + max(1, round(valid_s / self._period_s))
            command[0]["source"] = source_number(source)
            command[0]["verb"], command[0]["slot"] = verb, slot
            self._waiting[number] = future, now_s + VERDICT_S
            if not post(self._segment.mailbox, command[0]):
                del self._waiting[number]
                raise Refusal("overloaded", "too many commands wait for the control loop", "send fewer commands")
        return future

    def resolve(self, rows: np.ndarray) -> None:
        """Settle the commands judged in the controller records `rows` (n,)."""
        for row in rows[rows["command_sequence"] != 0]:
            with self._lock:
                future, _ = self._waiting.pop(int(row["command_sequence"]), (None, 0.0))
            if future is not None:
                _settle(future, row)

    def expire(self, now_s: float) -> None:
        """Give up on commands whose verdict is overdue."""
        with self._lock:
            late = [number for number, (_, until) in self._waiting.items() if until < now_s]
            futures = [self._waiting.pop(number)[0] for number in late]
        for future in futures:
            text = "the control loop did not answer; whether the command took effect is not known"
            future.set_exception(Refusal("no_verdict", text, "look at `rtctl status`", bound=f"{VERDICT_S:g} s"))


def _settle(future: "Future[int]", row: Any) -> None:
    if row["command_verdict"] == Reason.ACCEPTED:
        future.set_result(int(row["tick"]))
    else:
        future.set_exception(from_verdict(row))
