"""A client that asks as fast as it can, sense and nonsense: ``python -m rtctl.soak.storm``, ended by closing its input.

It prints what became of its requests as one line of JSON.
"""

import argparse
import json
import random
import select
import sys
import time
from collections import Counter
from typing import Any

import zenoh

from rtctl.client import NoReply, open_session
from rtctl.gateway.keys import REQUESTS

BATCH = 200
"""Requests under way at a time."""
BURST_S, REST_S = 2.0, 1.0
"""It pauses, so that other clients get a word in, and begins again, which is when things pile up."""
TIMEOUT_S = 5.0
RETRY_S = 0.1
STOPS = 0.001
"""Share of requests that really stop the robot."""
OVERSIZED_BYTES = 70_000
READERS = ("status", "param/get", "param/list")


class Storm:
    """One client's requests, drawn from a seed, and what became of them."""

    def __init__(self, robot: str, endpoint: str, seed: int) -> None:
        self._robot, self._endpoint = robot, endpoint
        self._random = random.Random(seed)
        self._sequence = 0
        self._session: zenoh.Session | None = None
        self.sent = self.answered = self.doubled = 0
        self.reasons: Counter[str] = Counter()
        self.unanswered_ns: list[tuple[int, int]] = []
        """Unix times from sending to giving up, of requests that got no reply"""
        self.slowest_s = 0.0

    def batch(self) -> None:
        """Send BATCH requests at once and wait for their replies."""
        if self._session is None and not self._connected():
            return
        assert self._session is not None
        begun_ns, waiting = time.time_ns(), []
        for _ in range(BATCH):
            key, payload = self._request()
            self.sent += 1
            try:
                waiting.append(self._session.get(key, payload=payload, timeout=TIMEOUT_S))
            except zenoh.ZError:
                self.unanswered_ns.append((begun_ns, time.time_ns()))
        answered = sum(self._take(replies, begun_ns) for replies in waiting)
        if not answered:  # the gateway is gone: a new one wants a new session
            self._session.close()
            self._session = None

    def _take(self, replies: Any, begun_ns: int) -> bool:
        found = [json.loads((r.ok or r.err).payload.to_bytes()) for r in replies if r.ok is not None or _is_json(r)]
        if not found:
            self.unanswered_ns.append((begun_ns, time.time_ns()))
            return False
        self.answered += 1
        self.doubled += len(found) > 1
        self.reasons["accepted" if found[0]["accepted"] else found[0]["reason"]] += 1
        self.slowest_s = max(self.slowest_s, 1e-9 * (time.time_ns() - begun_ns))
        return True

    def _connected(self) -> bool:
        try:
            self._session = open_session(self._endpoint)
        except NoReply:
            time.sleep(RETRY_S)
        return self._session is not None

    def _request(self) -> tuple[str, bytes]:
        """Key and payload of a request: a reader's, one without the lease, or damaged in some way."""
        draw = self._random
        self._sequence += 1
        name = draw.choice(READERS)
        content: dict[str, Any] = {"source": "storm", "sequence": self._sequence, "timestamp_ns": time.time_ns(), "valid_for_s": 5.0}  # fmt: skip
        kind = draw.random()
        if kind < STOPS:
            name = "stop"
        elif kind < 0.5:
            content |= {"names": ["loop.period_s"]} if name == "param/get" else {}
        elif kind < 0.6:
            name = draw.choice(list(REQUESTS))  # without the lease; its payload fits or does not
            content |= {
                "lease": draw.choice(["", "0" * 32]),
                "arguments": [draw.uniform(-1e3, 1e3)] * draw.randrange(9),
            }
            content |= {"valid_for_s": draw.choice([0.5, 0.0, -1.0, 1e9])} if name in ("stop", "lease/acquire") else {}
        elif kind < 0.65:
            name = "/".join("".join(draw.choices("abcdefghij-", k=draw.randrange(1, 9))) for _ in range(draw.randrange(1, 4)))  # fmt: skip
        payload = json.dumps(content).encode()
        if kind >= 0.65:
            payload = self._damaged(bytearray(payload), kind)
        return f"rtctl/{self._robot}/{name}", payload

    def _damaged(self, payload: bytearray, kind: float) -> bytes:
        draw = self._random
        if kind < 0.66:
            return bytes(OVERSIZED_BYTES)
        if kind < 0.75:
            return draw.randbytes(draw.randrange(400))
        for _ in range(draw.randrange(1, 8)):
            payload[draw.randrange(len(payload))] = draw.randrange(256)
        return bytes(payload[: draw.randrange(len(payload) + 1)])

    def as_table(self) -> dict[str, Any]:
        """The counts, for JSON."""
        return {
            "sent": self.sent, "answered": self.answered, "doubled": self.doubled, "reasons": dict(self.reasons),
            "unanswered_ns": self.unanswered_ns, "slowest_s": self.slowest_s,
        }  # fmt: skip


def _is_json(reply: Any) -> bool:
    """Zenoh itself says so with an error of its own when a reply did not come in time; the gateway's are JSON."""
    return reply.err is not None and reply.err.payload.to_bytes()[:1] == b"{"


def main() -> None:
    """Storm in bursts until standard input is closed."""
    parser = argparse.ArgumentParser(prog="rtctl.soak.storm", description=__doc__)
    parser.add_argument("--robot", required=True)
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--rest", type=float, default=REST_S, help="between two bursts [s]")
    arguments = parser.parse_args()
    storm = Storm(arguments.robot, arguments.endpoint, arguments.seed)
    begun, over = time.monotonic(), False
    while not over:
        over = bool(select.select([sys.stdin], [], [], 0.0)[0])
        if (time.monotonic() - begun) % (BURST_S + arguments.rest) < BURST_S:
            storm.batch()
        else:
            time.sleep(RETRY_S)
    print(json.dumps(storm.as_table()))


if __name__ == "__main__":
    main()
