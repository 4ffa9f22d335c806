"""The gateway's side of Zenoh: listens on one endpoint and nothing else, and answers every query.

Callbacks run on Zenoh's threads and do no more than queue the request. `stop` and the lease have a queue and a
worker of their own, so nothing slow can hold them up; when a queue is full the request is refused at once.
Replies leave from a thread of their own, because a client that reads slowly may block it, and nothing else.
"""

import json
import logging
import os
import threading
import time
from collections.abc import Callable
from functools import partial
from queue import Full, Queue, SimpleQueue
from typing import Any

import zenoh

from hal.errors import RtctlError
from rtctl.gateway import messages
from rtctl.gateway.keys import FEEDBACK, PUBLISHED, REQUESTS
from rtctl.gateway.messages import Answer, Reply
from rtctl.gateway.refusal import Refusal
from rtctl.gateway.transport import configure
from rtctl.settings import Gateway as Options

QUEUE_LENGTH = 64
CLOSE_S = 2.0
OPEN_S = 3.0
"""A port may stay taken for a moment after a gateway was killed."""

AnswerRequest = Callable[[str, bytes, Answer], None]
log = logging.getLogger(__name__)


class NetworkError(RtctlError):
    """The endpoint cannot be opened."""


class Network:
    """Opens the session and serves until closed. `answer` is called by the workers."""

    def __init__(self, robot_name: str, options: Options, answer: AnswerRequest) -> None:
        self._prefix, self._limit, self._answer = f"rtctl/{robot_name}", options.payload_limit_bytes, answer
        self._queues: dict[bool, Queue[Any]] = {urgent: Queue(QUEUE_LENGTH) for urgent in (False, True)}
        self._replies: SimpleQueue[Any] = SimpleQueue()
        self._session = _open(options)
        drop = zenoh.CongestionControl.DROP
        self._publishers = {
            key: self._session.declare_publisher(
                f"{self._prefix}/{key}",
                congestion_control=drop,
                encoding=zenoh.Encoding("application/cdr" if key == "record" else "application/json"),
                express=key not in FEEDBACK,
            )
            for key in PUBLISHED
            if key != "alive"
        }
        self._threads = [
            threading.Thread(target=self._work, args=(self._queues[False],), name="requests", daemon=True),
            threading.Thread(target=self._work, args=(self._queues[True],), name="urgent", daemon=True),
            threading.Thread(target=self._reply, name="replies", daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        self._queryable = self._session.declare_queryable(f"{self._prefix}/**", self._on_query, complete=True)
        self._token = self._session.liveliness().declare_token(f"{self._prefix}/alive")

    def publish(self, key: str, payload: bytes) -> None:
        """Put `payload` on a key of :data:`rtctl.gateway.keys.PUBLISHED`; dropped rather than waited for."""
        try:
            self._publishers[key].put(payload)
        except zenoh.ZError as error:
            log.warning("cannot publish %s: %s", key, error)

    def close(self) -> None:
        """Leave the network; never takes longer than a few seconds."""
        closing = threading.Thread(target=self._close, name="closing", daemon=True)
        closing.start()
        closing.join(CLOSE_S)

    def _close(self) -> None:
        self._token.undeclare()
        self._queryable.undeclare()
        for queue in self._queues.values():
            queue.put(None)
        for thread in self._threads[:-1]:
            thread.join(CLOSE_S / 4)
        self._replies.put(None)
        self._threads[-1].join(CLOSE_S / 4)
        for publisher in self._publishers.values():
            publisher.undeclare()
        self._session.close()

    def _on_query(self, query: zenoh.Query) -> None:
        """Queue a query. Keys may have wildcards in front of the last part, so that one stop reaches all robots."""
        name = "/".join(str(query.key_expr).split("/")[2:])
        try:
            key = REQUESTS.get(name)
            payload = query.payload
            if key is None:
                raise Refusal("unknown_key", f"there is no key {query.key_expr}", "see docs/reference/keys.md")
            if payload is not None and len(payload) > self._limit:
                what = "the request is too large and was not read"
                raise Refusal("oversized", what, "send less", len(payload), f"at most {self._limit} bytes")
            self._queues[key.urgent].put_nowait((query, name, payload))
        except Refusal as refusal:
            self._send(query, name, messages.refuse(refusal))
        except Full:
            overload = Refusal("overloaded", "too many requests wait", "send fewer requests", bound=str(QUEUE_LENGTH))
            self._send(query, name, messages.refuse(overload))

    def _work(self, queue: "Queue[Any]") -> None:
        while (item := queue.get()) is not None:
            query, name, payload = item
            data = b"" if payload is None else payload.to_bytes()
            self._answer(name, data, partial(self._send, query, name))

    def _send(self, query: zenoh.Query, name: str, reply: Reply, data: bytes = b"") -> None:
        self._replies.put((query, name, reply, data))

    def _reply(self) -> None:
        while (item := self._replies.get()) is not None:
            query, name, reply, data = item
            try:
                wild = "*" in str(query.key_expr)
                if wild and name not in REQUESTS:
                    query.reply_err(messages.encode(reply))
                else:
                    key = f"{self._prefix}/{name}" if wild else query.key_expr
                    query.reply(key, messages.encode(reply), attachment=data or None)
            except Exception:  # a client that is gone must not end the thread that answers the others
                log.warning("cannot reply to %s", query.key_expr, exc_info=True)
            finally:
                query.drop()


def _open(options: Options) -> zenoh.Session:
    config = configure("peer", options.user, options.password)
    config.insert_json5("listen/endpoints", json.dumps([options.endpoint]))
    config.insert_json5("listen/exit_on_failure", "true")
    passwords = -1
    if options.user:  # Zenoh wants a file; this one has no name and ends with the process
        passwords = os.memfd_create("passwords")
        os.write(passwords, f"{options.user}:{options.password}\n".encode())
        config.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(f"/proc/self/fd/{passwords}"))
    until = time.monotonic() + OPEN_S
    try:
        while True:
            try:
                return zenoh.open(config)
            except zenoh.ZError as error:
                if time.monotonic() > until:
                    remedy = "another controller may be running; stop it or set gateway.endpoint"
                    raise NetworkError(f"cannot listen: {error}", value=options.endpoint, remedy=remedy) from None
                time.sleep(0.2)
    finally:
        if passwords >= 0:
            os.close(passwords)
