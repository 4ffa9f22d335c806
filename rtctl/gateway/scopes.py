"""The scopes of clients: a bounded number of them, each of a bounded size, none longer than its client lives.

The thread that drains feeds them, some rows at a time: a scope has the same work with one row as with fifty. Requests
come from a worker. Both hold the lock for no longer than the scopes take to look at one batch.
"""

import logging
import secrets
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from hal.signals import Table
from rtctl.gateway.messages import Reply, Request, ScopeOpenRequest, ScopeRequest
from rtctl.gateway.refusal import Refusal, from_error
from rtctl.scope.pairing import Pairing
from rtctl.scope.probe import Rows
from rtctl.scope.scope import Scope
from rtctl.scope.setup import ScopeError

SCOPES = 8
SILENT_S = 5.0
"""A scope whose client says nothing for so long is forgotten."""
CAPTURE_BYTES = 8 * 1024 * 1024
"""What a capture may take, and once more what finished captures of a scope may take until they are fetched."""
PIECE_BYTES = 128 * 1024
"""A reply carries no more, so that no other reply waits long behind it."""
BATCH_S, BATCH_ROWS = 0.05, 256
"""Rows are collected so long, or until there are so many."""
REMEDY = "open a new one; it dies when its client is silent, and with the gateway"

NOTHING = np.zeros(0)

log = logging.getLogger(__name__)


@dataclass
class _Open:
    scope: Scope
    owner: str
    heard_s: float
    seen: int = 0
    """captures its client has"""
    failure: str = ""


class Scopes:
    """All scopes of one gateway. Safe to call from several threads."""

    def __init__(self, tables: Mapping[str, Table]) -> None:
        self._tables = tables
        self._open: dict[str, _Open] = {}
        self._batch: tuple[list[np.ndarray], list[np.ndarray]] = [], []
        self._rows, self._since_s = 0, 0.0
        self._pairing = Pairing()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._open)

    def feed(self, records: np.ndarray, truths: np.ndarray) -> None:
        """The next rows of both rings, and the end of scopes whose clients are silent."""
        if not self._open:
            return
        now_s = time.monotonic()
        with self._lock:
            for collected, rows in zip(self._batch, (records, truths), strict=True):
                if len(rows):
                    collected.append(rows.copy())
                    self._rows += len(rows)
            if self._rows >= BATCH_ROWS or now_s - self._since_s >= BATCH_S:
                self._since_s = now_s
                self._look()
                for token, entry in list(self._open.items()):
                    if now_s - entry.heard_s > SILENT_S:
                        del self._open[token]

    def answer(self, name: str, request: Request) -> tuple[Reply, bytes]:
        """Handle a request on one of the keys ``scope/...``; the bytes are those of a capture.

        Raises:
            Refusal: no such scope, no room for another one, or it cannot do what is asked.
        """
        if isinstance(request, ScopeOpenRequest):
            return Reply(accepted=True, result=self._begin(request)), b""
        assert isinstance(request, ScopeRequest)
        with self._lock:
            entry = self._open.get(request.scope)
            if entry is None:
                raise Refusal("no_scope", "there is no such scope", REMEDY)
            if entry.failure:
                raise Refusal(
                    "internal", f"the scope failed: {entry.failure}", "report it; it is in the gateway's journal"
                )
            entry.heard_s = time.monotonic()
            while entry.seen < request.seen and entry.scope.finished:
                entry.scope.take()
                entry.seen += 1
            if name == "scope/close":
                del self._open[request.scope]
            elif name == "scope/force":
                self._look()  # what was collected was before
                entry.scope.force()
            elif name == "scope/read":
                return _piece(entry, request.offset)
            return Reply(accepted=True, result=_state(entry)), b""

    def _begin(self, request: ScopeOpenRequest) -> dict[str, Any]:
        try:
            scope = Scope(request.setup, self._tables, CAPTURE_BYTES)
        except ScopeError as error:
            raise from_error("invalid_scope", error) from None
        token = secrets.token_hex(16)
        with self._lock:
            self._look()
            if len(self._open) >= SCOPES:
                owners = ", ".join(sorted({entry.owner for entry in self._open.values()}))
                text = f"there are too many scopes already, of {owners}"
                raise Refusal("too_many_scopes", text, "stop one of them", len(self._open), SCOPES)
            entry = self._open[token] = _Open(scope, request.source, time.monotonic())
            return {"scope": token, "signals": msgspec.to_builtins(scope.signals), **_state(entry)}

    def _look(self) -> None:
        """Have all scopes look at what was collected."""
        records, truths = (np.concatenate(part) if part else NOTHING for part in self._batch)
        self._batch, self._rows = ([], []), 0
        if not any(entry.scope.needs_truth for entry in self._open.values()):
            self._pairing, paired = Pairing(), Rows(NOTHING)
        else:
            paired = self._pairing.pair(records, truths)
        for entry in self._open.values():
            if not entry.failure:
                self._attempt(entry, paired if entry.scope.needs_truth else Rows(records))

    def _attempt(self, entry: _Open, rows: Rows) -> None:
        try:
            entry.scope.feed(rows)
        except Exception as error:  # a scope that breaks must not take the gateway with it: the robot would stop
            log.exception("a scope of %s failed", entry.owner)
            entry.failure = repr(error)
            entry.scope.finished.clear()


def _state(entry: _Open) -> dict[str, Any]:
    scope = entry.scope
    return {"state": scope.state, "filled": scope.filled, "finished": entry.seen + len(scope.finished)}


def _piece(entry: _Open, offset: int) -> tuple[Reply, bytes]:
    """A piece of the oldest capture that its client has not seen."""
    if not entry.scope.finished:
        raise Refusal("no_capture", "no capture waits to be read", "ask `scope/state` for how many are finished")
    capture = entry.scope.finished[0]
    data = capture.rows.view(np.uint8)
    if offset >= len(data):
        raise Refusal("no_capture", "the capture is not so long", "read on from 0", offset, f"less than {len(data)}")
    result = {"size": len(data), "facts": capture.facts()}
    return Reply(accepted=True, result=result), data[offset : offset + PIECE_BYTES].tobytes()
