"""(f) What it costs to hand a record from one process to the other, and to look for a command."""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.figures import Figure
from bench.recorded import Piece
from hal.backend import load
from hal.kernel import kernel
from rtctl.commands import Verb
from rtctl.controller import Controller
from rtctl.exchange.mailbox import post
from rtctl.exchange.poll import new_poller, poll
from rtctl.exchange.ring import RingReader, commit
from rtctl.exchange.segment import Segment
from rtctl.gateway.events import Watcher
from rtctl.handover import layout
from rtctl.log.format import CONTROLLER
from rtctl.log.writer import LogWriter
from rtctl.settings import Settings

PART = "exchange"
TICKS = 5000
ROUNDS = 7
BLOCK = 4
"""Records that are new when a gateway in step looks."""


def measure(settings: Settings, pieces: Sequence[Piece]) -> list[Figure]:
    """Costs on the real-time side and on that of the gateway, with the records of an insertion."""
    controller, choice = Controller(settings), settings.backend
    backend = load(choice.name, choice.options, period_s=settings.loop.period_s, seed=0)
    segment = Segment.create(layout(controller, backend))
    rows = next(p for p in pieces if p.verb == Verb.INSERT).records[:TICKS].copy()
    costs: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        found = _real_time_us(segment, controller, rows) | _gateway_us(settings, segment, controller, rows)
        for name, cost_us in found.items():
            costs.setdefault(name, []).append(cost_us)
    segment.close()
    note = f"{rows.itemsize} bytes"
    return [Figure(PART, name, "us", float(np.median(c)), note=note) for name, c in costs.items()]


def _real_time_us(segment: Segment, controller: Controller, rows: np.ndarray) -> dict[str, float]:
    """What the loop does every tick, in one compiled loop each [us]."""
    poller, command = new_poller(segment.control), controller.command
    calls = {
        "commit a record to the ring": lambda: _commit(segment.records, rows),
        "poll the gateway, no command": lambda: _poll(segment.control, segment.mailbox, poller, command, TICKS),
        "post a command and poll it": lambda: _exchange(segment.control, segment.mailbox, poller, command, TICKS),
    }
    costs = {}
    for name, call in calls.items():
        start = time.perf_counter()
        call()
        costs[name] = (time.perf_counter() - start) / TICKS * 1e6
    return costs


def _gateway_us(settings: Settings, segment: Segment, controller: Controller, rows: np.ndarray) -> dict[str, float]:
    """What a gateway does with every record, a few at a time [us]."""
    reader = RingReader(segment.records, rows.dtype, position=int(segment.records[0, 0]))
    watcher, spent_s = Watcher(), np.zeros(3)
    with tempfile.TemporaryDirectory() as directory:
        tables, chunk = {CONTROLLER: controller.table}, settings.log.chunk_kib * 1024
        log = LogWriter(Path(directory) / "log.mcap", tables, {}, chunk_bytes=chunk)
        for k in range(0, len(rows), BLOCK):
            _commit(segment.records, rows[k : k + BLOCK])
            times = [time.perf_counter()]
            block = reader.read()
            times.append(time.perf_counter())
            watcher.watch(block)
            times.append(time.perf_counter())
            log.write_rows(CONTROLLER, block)
            times.append(time.perf_counter())
            spent_s += np.diff(times)
        log.close()
    assert reader.lost == 0
    names = ("gateway: drain a record", "gateway: watch it for events", "gateway: log it")
    return dict(zip(names, (spent_s / len(rows) * 1e6).tolist(), strict=True))


@kernel
def _commit(ring, rows):
    for k in range(rows.shape[0]):
        commit(ring, rows[k])


@kernel
def _poll(control, mailbox, poller, command, times):
    for _ in range(times):
        poll(control, mailbox, poller[0], command[0], 100)


@kernel
def _exchange(control, mailbox, poller, command, times):
    for _ in range(times):
        post(mailbox, command[0])
        poll(control, mailbox, poller[0], command[0], 100)
