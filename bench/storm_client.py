"""A client of :mod:`bench.storm`: `python -m bench.storm_client ENDPOINT ROBOT` asks until SIGTERM, and says how often.

Queries go out without waiting for replies, at most WINDOW at a time: valid ones, and ones no client would ever send.
"""

import itertools
import json
import signal
import sys
import threading
from typing import Any

import zenoh

from rtctl.client import open_session
from rtctl.machine import die_with_parent

WINDOW = 32
REPLY_S = 2.0
BROKEN = (b"", b"{", b"\xff\xfe\x00", b"[" * 2000, b'{"source": 3, "sequence": -1}', b"x" * 70_000)
"""The last is more than the gateway reads."""
KEYS = ("status", "param/get", "enable", "move_cp", "no/such/key")


def main() -> None:
    """See the head of the module."""
    die_with_parent()
    endpoint, robot = sys.argv[1:]
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    free, asked = threading.Semaphore(WINDOW), 0
    session = open_session(endpoint)
    print("begun", flush=True)
    for number, key, broken in zip(itertools.count(), itertools.cycle(KEYS), itertools.cycle(BROKEN)):
        if ended.is_set():
            break
        valid = {"source": "storm", "sequence": number, "timestamp_ns": 0, "valid_for_s": 0.5}
        payload = broken if number % 2 else json.dumps(valid).encode()
        free.acquire(timeout=REPLY_S)
        handler: Any = zenoh.handlers.Callback(lambda _reply: None, free.release)
        session.get(f"rtctl/{robot}/{key}", handler, payload=payload, timeout=REPLY_S)
        asked += 1
    print(asked, flush=True)
    session.close()


if __name__ == "__main__":
    main()
