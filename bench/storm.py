"""(h) Whether a storm of clients on the gateway makes the loop late: seconds of storm and of calm in turns, in one run."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from bench.figures import Figure, Target, compare, in_turns
from bench.real_time import BenchError
from rtctl.daemon import Daemon
from rtctl.exchange.control import RealTimeState, Word, get
from rtctl.exchange.ring import RingReader
from rtctl.machine import loop_core
from rtctl.readiness.direct import GLANCE_S, run_daemon
from rtctl.settings import Settings

PART = "storm"
TARGET = Target(1.2)
PERCENTILES = {50.0: None, 99.0: TARGET, 99.9: None}
CLIENTS = 2
SETTLE_S, START_S = 0.3, 3.0


def measure(settings: Settings, rounds: int, seconds: float) -> list[Figure]:
    """Ratios of the percentiles of the lateness in a storm to those in calm, round by round.

    Raises:
        BenchError: the daemon failed, or records were lost.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    settings = replace(settings, gateway=replace(settings.gateway, endpoint=endpoint))
    lateness: list[list[np.ndarray]] = []
    asked: list[int] = []

    def operate(daemon: Daemon) -> None:
        with _clients(settings) as clients:
            for client in clients:
                os.kill(client.pid, signal.SIGSTOP)

            def stormy() -> np.ndarray:
                for client in clients:
                    os.kill(client.pid, signal.SIGCONT)
                try:
                    return _lateness_us(daemon, seconds)
                finally:
                    for client in clients:
                        os.kill(client.pid, signal.SIGSTOP)

            lateness.extend(in_turns(rounds, stormy, lambda: _lateness_us(daemon, seconds)))
            for client in clients:
                os.kill(client.pid, signal.SIGCONT)
            asked.extend(_count(client) for client in clients)

    run_daemon(settings, operate, gateway=True)
    storm, calm = np.array(lateness)
    note = f"{CLIENTS} clients, {sum(asked) / (rounds * (seconds + SETTLE_S) + START_S):.0f} queries/s, a third of them malformed"
    figures = []
    for k, (percent, target) in enumerate(PERCENTILES.items()):
        name, ours, theirs = f"lateness p{percent:g} in a storm", storm[:, k], calm[:, k]
        figure = compare(PART, name, "us", ours, theirs, reference_name="calm", target=TARGET, note=note)
        figures.append(replace(figure, target=target))
    return figures


def _lateness_us(daemon: Daemon, seconds: float) -> np.ndarray:
    """Percentiles of the lateness [us] over `seconds`, after a moment for things to settle. Raises BenchError."""
    time.sleep(SETTLE_S)
    control, layout = daemon.control, daemon.segment.layout
    ring = RingReader(daemon.segment.records, layout.record, position=int(daemon.segment.records[0, 0]))
    end_s, lateness_ns = time.monotonic() + seconds, []
    while time.monotonic() < end_s and get(control, Word.REAL_TIME_STATE) < RealTimeState.STOPPED:
        time.sleep(GLANCE_S)
        lateness_ns.append(ring.read()["lateness_ns"].copy())
    if ring.lost or not any(len(rows) for rows in lateness_ns):
        raise BenchError("records were lost", value=ring.lost, bound="0", remedy="relieve the machine")
    return np.percentile(np.concatenate(lateness_ns), tuple(PERCENTILES)) * 1e-3


@contextlib.contextmanager
def _clients(settings: Settings) -> Iterator[list[subprocess.Popen]]:
    """Clients of the soak that ask without a rest, each a process of its own at normal priority.

    Real ones are on other machines: here they are kept off the loop's core, unless it is the only one. The gateway is not.
    """
    cores = os.sched_getaffinity(0)
    cores = cores - {loop_core(settings.loop.cpu)} or cores
    command = [sys.executable, "-m", "rtctl.soak.storm", "--rest", "0"]
    command += ["--robot", settings.robot.name, "--endpoint", settings.gateway.endpoint, "--seed"]
    clients: list[subprocess.Popen] = []
    try:
        for seed in range(CLIENTS):
            clients.append(subprocess.Popen([*command, str(seed)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))  # fmt: skip
            os.sched_setaffinity(clients[-1].pid, cores)  # before it has threads
        time.sleep(START_S)
        yield clients
    finally:
        for client in clients:
            client.kill()
            client.wait()


def _count(client: subprocess.Popen) -> int:
    """End a client by closing its input, and take the number of its queries."""
    text, _ = client.communicate()
    return int(json.loads(text)["sent"])
