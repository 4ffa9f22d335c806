"""What scripts and the command line use to talk to a running controller.

    with Client("planar") as robot:
        robot.command(Verb.ENABLE)
        robot.command(Verb.MOVE_CP, 160.0, 0.0, 0.0)
        robot.wait(lambda row: not row["is_busy"], timeout_s=20.0, what="the move")

Everybody may read and stop. The first command that needs the lease acquires it, a thread keeps it alive, and
leaving the context gives it back.
"""

import contextlib
import itertools
import json
import socket
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, Self

import msgspec
import numpy as np
import zenoh

from hal.errors import RtctlError
from rtctl.commands import CommandRefused, Verb
from rtctl.gateway.keys import REQUESTS, STAGED, key_of
from rtctl.gateway.transport import configure
from rtctl.record import CDR_HEADER, controller_table

if TYPE_CHECKING:
    from rtctl.scope.client import RemoteScope
    from rtctl.scope.setup import Trigger

CONNECT_S = 1.0
CLOSE_S = 2.0
DROP_AFTER_US = 50_000
"""How long a request may wait for room on its way out; nobody's loop waits here."""
MAX_DOF = 6
SILENCE_S = 5.0
"""Longer than a gateway that died takes to come back."""
RENEWALS = 4
"""Heartbeats within the life of a lease."""

Done = Callable[[Any], bool]


class NoReply(RtctlError):
    """Nobody answered."""

    exit_code = 3


class WaitedTooLong(RtctlError):
    """Something awaited did not happen in time."""


class RecordsStopped(RtctlError):
    """The controller fell silent while something was awaited."""

    exit_code = 3


@dataclass(frozen=True)
class Reply:
    """An accepted request: the tick at which it takes effect, if it reaches the tick, and what was asked for."""

    tick: int | None = None
    result: dict[str, Any] = field(default_factory=dict)
    data: bytes = b""
    """of a capture"""


class Client:
    """A connection to one controller; a context manager.

    Args:
        robot: name of the robot in every key.
        endpoint: where its gateway listens.
        source: name that other clients see when this one holds the lease.
        timeout_s: how long a reply may take.
        user, password: where the endpoint is open to others than this machine.

    Raises:
        NoReply: nobody listens at the endpoint.
    """

    def __init__(
        self,
        robot: str = "planar",
        endpoint: str = "tcp/127.0.0.1:7447",
        source: str = "",
        timeout_s: float = 2.0,
        user: str = "",
        password: str = "",
    ) -> None:
        self.robot, self.endpoint, self.timeout_s = robot, endpoint, timeout_s
        self.source = source or f"{socket.gethostname()}-{threading.get_native_id()}"
        self._sequence = itertools.count(1)
        self._lease, self._lease_s = "", 1.0
        self._lease_lock = threading.Lock()
        self._command_lock = threading.Lock()
        self._closing = threading.Event()
        self._fresh = threading.Condition()
        self._record: np.ndarray | None = None
        self._session = open_session(endpoint, user, password)
        self._subscribers = [self._session.declare_subscriber(self._key("record"), self._on_record)]
        self._renewer = threading.Thread(target=self._renew, name="lease", daemon=True)
        self._renewer.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the lease back and leave; never takes longer than a few seconds."""
        if self._closing.is_set():
            return
        self._closing.set()
        closing = threading.Thread(target=self._close, name="closing", daemon=True)
        closing.start()
        closing.join(CLOSE_S)

    def command(self, verb: Verb, *arguments: float, valid_for_s: float = 0.5) -> Reply:
        """Have the controller do `verb`; its arguments are documented at :class:`rtctl.commands.Verb`.

        Raises:
            CommandRefused: it was refused, with the reason and the remedy.
            NoReply: nobody answered; whether it took effect is not known.
        """
        if verb == Verb.NONE or verb in STAGED:
            raise ValueError(f"{verb.name} is not for clients: use plan() or set_parameters()")
        fields = {"arguments": [float(a) for a in arguments]}
        return self._request(key_of(verb), fields, valid_for_s=valid_for_s)

    def stop(self) -> Reply:
        """Brake and hold; needs no lease."""
        return self.command(Verb.STOP)

    def plan(self, document: dict[str, Any] | None = None, timeout: float = 60.0) -> Reply:
        """Have the insertion planned from the registered entry and loaded.

        Args:
            document: of :func:`rtctl.plan_file.document`; placed at the entry and loaded instead of planning anew.

        Raises:
            CommandRefused: there is no plan the robot can carry out, or it cannot be loaded now.
            NoReply: nobody answered within `timeout` seconds.
        """
        return self._request("plan", {} if document is None else {"plan": document}, timeout_s=timeout)

    def status(self) -> dict[str, Any]:
        """Everything an operator wants to see at a glance."""
        return self._request("status", {}).result

    def parameters(self, *names: str) -> dict[str, Any]:
        """Values in force by dotted name; of all options without `names`."""
        return self._request("param/get", {"names": list(names)}).result

    def parameter_reference(self) -> dict[str, dict[str, Any]]:
        """Every option: value, unit, bound, doc, and whether it is live."""
        return self._request("param/list", {}).result

    def set_parameters(self, values: dict[str, Any]) -> Reply:
        """Change live options (dotted name -> value) together; result["number"] is the number of the new set."""
        return self._request("param/set", {"values": values})

    def latest(self) -> Any:
        """The newest controller record, a structured scalar (:func:`rtctl.record.controller_table`), or None."""
        with self._fresh:
            return None if self._record is None else self._record[0]

    def wait(self, done: Done, timeout_s: float, what: str = "it") -> Any:
        """The first record, from the newest on, for which done(record) is true.

        Raises:
            WaitedTooLong: there was none within `timeout_s` seconds.
            RecordsStopped: records came and then stayed away, longer than a gateway takes to be restarted.
        """
        begin = time.monotonic()
        until, heard = begin + timeout_s, begin
        seen = None
        with self._fresh:
            while True:
                record, seen_before = self._record, seen
                seen = record
                if record is not None and record is not seen_before:
                    heard = time.monotonic()
                    if done(record[0]):
                        return record[0]
                silent = record is not None and time.monotonic() - heard > SILENCE_S
                if silent or (
                    not self._fresh.wait(min(until - time.monotonic(), SILENCE_S)) and time.monotonic() >= until
                ):
                    break
        if silent:
            raise RecordsStopped(f"the controller fell silent while waiting for {what}", bound=f"a record every {SILENCE_S:g} s", remedy=self._who_is_there())  # fmt: skip
        if record is None:
            raise WaitedTooLong(f"no record arrived while waiting for {what}", remedy=self._who_is_there())
        raise WaitedTooLong(f"{what} did not happen in time", bound=f"{timeout_s:g} s", remedy="look at `rtctl status`")

    def on_event(self, callback: Callable[[dict[str, Any]], object]) -> None:
        """Have `callback` called with every event from now on, on a thread of its own."""
        self.subscribe("events", callback)

    def subscribe(self, key: str, callback: Callable[[dict[str, Any]], object]) -> None:
        """Have `callback` called with every JSON message on a key of :data:`rtctl.gateway.keys.PUBLISHED`."""

        def receive(sample: zenoh.Sample) -> None:
            callback(json.loads(sample.payload.to_bytes()))

        self._subscribers.append(self._session.declare_subscriber(self._key(key), receive))

    def scope(
        self, signals: Sequence[str], trigger: "Trigger | str | None" = None, *, edge: str = "", **setup: Any
    ) -> "RemoteScope":
        """Open a scope: captures of `signals` at the full rate around a trigger; needs no lease.

        Args:
            signals: names of signals of the record, ``wrench_in_base[2]`` for one number of a vector.
            trigger: one of :data:`rtctl.scope.setup.Trigger`, or text as in ``'force_axial_n < -0.05'``; None: at once.
            edge: with a text: rising, falling or either, to wait for the edge and not for the level.
            setup: samples, pre, decimation, captures, auto of :class:`rtctl.scope.setup.Setup`.

        Raises:
            ScopeError: the setup is not one.
            CommandRefused: it is refused, with the reason and the remedy.
        """
        from rtctl.scope.client import RemoteScope
        from rtctl.scope.setup import Free, make_setup, parse_trigger

        chosen = parse_trigger(trigger, edge) if isinstance(trigger, str) else trigger or Free()
        return RemoteScope(self._request, make_setup(signals=signals, trigger=chosen, **setup))

    def is_alive(self) -> bool:
        """True if a gateway of this robot is on the network."""
        replies = self._session.liveliness().get(self._key("alive"), timeout=self.timeout_s)
        return any(reply.ok is not None for reply in replies)

    def acquire(self) -> None:
        """Become the one writer now; otherwise the first command does it. Raises CommandRefused if another one is."""
        with self._lease_lock:
            if not self._lease:
                result = self._ask("lease/acquire", {}).result
                self._lease_s = float(result["lease_s"])
                self._lease = str(result["lease"])

    def _request(
        self, name: str, fields: dict[str, Any], *, timeout_s: float | None = None, valid_for_s: float = 0.5
    ) -> Reply:
        """A request with the lease where it needs one; numbered and sent in one piece, so that none overtakes."""
        if not REQUESTS[name].lease:
            return self._ask(name, fields, timeout_s=timeout_s, valid_for_s=valid_for_s)
        self.acquire()
        with self._command_lock:
            try:
                return self._ask(name, {**fields, "lease": self._lease}, timeout_s=timeout_s, valid_for_s=valid_for_s)
            except CommandRefused as refused:
                if refused.reason == "no_lease":
                    self._lease = ""  # the next command acquires it anew; this one was meant for what was before
                raise

    def _ask(
        self, name: str, fields: dict[str, Any], *, timeout_s: float | None = None, valid_for_s: float = 0.5
    ) -> Reply:
        request = {
            "source": self.source,
            "sequence": next(self._sequence),
            "timestamp_ns": time.time_ns(),
            "valid_for_s": valid_for_s,
            **fields,
        }
        replies = self._session.get(
            self._key(name),
            payload=msgspec.json.encode(request),
            encoding=zenoh.Encoding("application/json"),
            timeout=timeout_s or self.timeout_s,
            consolidation=zenoh.ConsolidationMode.NONE,  # the first reply is the reply
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH,  # a queue of its own, also for the reply
            express=True,
        )
        for reply in replies:
            if reply.ok is not None:
                return _read(reply.ok)
        bound = f"within {timeout_s or self.timeout_s:g} s"
        raise NoReply(f"no reply to {name}", bound=bound, remedy=self._who_is_there())

    def _who_is_there(self) -> str:
        if self._closing.is_set() or not self.is_alive():
            return f"no controller of {self.robot!r} is alive at {self.endpoint}: start it with `rtctl run`"
        return "the controller is alive but did not answer: look at `rtctl status`"

    def _renew(self) -> None:
        while not self._closing.wait(self._lease_s / RENEWALS):
            lease = self._lease
            if lease:
                try:
                    self._ask("lease/renew", {"lease": lease}, timeout_s=self._lease_s)
                except CommandRefused:
                    self._lease = ""
                except (NoReply, zenoh.ZError):
                    continue  # its end is the gateway's to decide

    def _on_record(self, sample: zenoh.Sample) -> None:
        data = sample.payload.to_bytes()
        dtype = _dtype(len(data) - len(CDR_HEADER))
        if dtype is not None:
            with self._fresh:
                self._record = np.frombuffer(data, dtype, offset=len(CDR_HEADER))
                self._fresh.notify_all()

    def _close(self) -> None:
        lease, self._lease = self._lease, ""
        if lease:
            with contextlib.suppress(RtctlError, zenoh.ZError):  # it dies of silence
                self._ask("lease/release", {"lease": lease}, timeout_s=CLOSE_S / 4)
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._session.close()

    def _key(self, name: str) -> str:
        return f"rtctl/{self.robot}/{name}"


def open_session(endpoint: str, user: str = "", password: str = "") -> zenoh.Session:
    """A session with the gateway at `endpoint` and nobody else.

    Raises:
        NoReply: nobody listens there.
    """
    config = configure("client", user, password)
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("transport/link/tx/queue/congestion_control/drop/wait_before_drop", str(DROP_AFTER_US))
    config.insert_json5("connect/timeout_ms", str(round(1e3 * CONNECT_S)))
    config.insert_json5("connect/exit_on_failure", "true")
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        remedy = "start the controller with `rtctl run`; if it runs, check endpoint, user and password"
        raise NoReply("nobody answers", value=endpoint, remedy=remedy) from None


def _read(sample: zenoh.Sample) -> Reply:
    content = json.loads(sample.payload.to_bytes())
    if content["accepted"]:
        data = b"" if sample.attachment is None else sample.attachment.to_bytes()
        return Reply(content.get("tick"), content.get("result", {}), data)
    bound = content.get("bound")
    raise CommandRefused(
        content.get("reason", ""),
        content.get("text", ""),
        value=content.get("value"),
        bound="" if bound is None else str(bound),
        remedy=content.get("remedy", ""),
    )


@cache
def _dtype(size: int) -> np.dtype | None:
    """The record of that many bytes: robots differ in their degrees of freedom only."""
    for dof in range(1, MAX_DOF + 1):
        dtype = controller_table(dof).dtype
        if dtype.itemsize == size:
            return dtype
    return None
