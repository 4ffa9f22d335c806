"""(e) Whether the processes of the daemon grow while they run: resident size, once a second."""

import contextlib
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from bench.figures import Figure, Target
from rtctl.client import Client, CommandRefused
from rtctl.commands import Verb
from rtctl.daemon import Daemon
from rtctl.lifecycle import Operating
from rtctl.readiness.direct import run_daemon
from rtctl.readiness.operation import RECOVERY
from rtctl.settings import Settings

PART = "memory"
TARGET_KIB = Target(0.0)
MOVE_LIMIT_S = 20.0


def measure(settings: Settings, minutes: float) -> list[Figure]:
    """Growth of the resident sizes over a run with gateway and log, in which a client moves the robot to and fro.

    Raises:
        RtctlError: the daemon or a move failed.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    settings = replace(settings, gateway=replace(settings.gateway, endpoint=endpoint))
    samples: list[tuple[float, int, int]] = []
    done = ""

    def operate(daemon: Daemon) -> None:
        nonlocal done
        end_s = time.monotonic() + 60.0 * minutes
        with ThreadPoolExecutor(1) as beside:
            moving = beside.submit(_keep_moving, settings, end_s)
            _sample(daemon, end_s, samples)
            done = "{} moves, {} interruptions".format(*moving.result())

    run_daemon(settings, operate, gateway=True)
    time_s, real_time_kib, gateway_kib = np.array(samples, dtype=float).T
    return [
        _figure("real-time process", time_s, real_time_kib, TARGET_KIB, done),
        _figure("gateway", time_s, gateway_kib, None, done),
    ]


def _keep_moving(settings: Settings, end_s: float) -> tuple[int, int]:
    """Home, then move between two poses until the time is over; the moves, and how often something interrupted them."""
    aside, entry = (np.array(p) for p in (settings.workflow.retracted_pose_mm_rad, settings.workflow.entry_pose_mm_rad))
    moves = interruptions = 0
    with Client(settings.robot.name, settings.gateway.endpoint, "bench") as client:
        client.command(Verb.ENABLE)
        client.wait(lambda r: r["powered"], MOVE_LIMIT_S, "power")
        client.command(Verb.HOME)
        client.wait(lambda r: r["is_homed"] and not r["is_busy"], MOVE_LIMIT_S, "homing")
        while time.monotonic() < end_s:
            try:
                begun = client.command(Verb.MOVE_CP, *(aside if moves % 2 == 0 else 0.5 * (aside + entry))).tick or 0
                client.wait(partial(_has_arrived, begun), MOVE_LIMIT_S, "the move")
                moves += 1
            except CommandRefused:
                interruptions += 1
                _recover(client)
    return moves, interruptions


def _recover(client: Client) -> None:
    """A machine that stalls pauses the motion or trips the watchdog; over ten minutes that may well happen."""
    operating = Operating(int(client.latest()["operating_state"]))
    time.sleep(1.0)  # for the cause to pass; if it has not, the next move is refused, and we come back
    with contextlib.suppress(CommandRefused):
        for verb in RECOVERY[operating]:
            client.command(verb)


def _has_arrived(begun: int, record: np.void) -> bool:
    """True once a motion that began at tick `begun` is over."""
    return bool(record["tick"] > begun and not record["is_busy"])


def _sample(daemon: Daemon, end_s: float, samples: list[tuple[float, int, int]]) -> None:
    """Append (time [s], resident size of the real-time process, of the gateway [KiB]) every second."""
    next_s = time.monotonic()
    while next_s < end_s:
        assert daemon.real_time is not None
        assert daemon.gateway is not None
        samples.append((time.monotonic(), _resident_kib(daemon.real_time.pid), _resident_kib(daemon.gateway.pid)))
        next_s += 1.0
        time.sleep(max(next_s - time.monotonic(), 0.0))


def _resident_kib(pid: int) -> int:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS:"))


def _figure(who: str, time_s: np.ndarray, size_kib: np.ndarray, target: Target | None, done: str) -> Figure:
    """Last size less the first one; the slope of a line through all of them tells a trend from a step."""
    slope = float(np.polyfit((time_s - time_s[0]) / 60.0, size_kib, 1)[0])
    first, last = size_kib[0] / 1024.0, size_kib[-1] / 1024.0
    note = f"{first:.2f} MiB at first, {last:.2f} at last, slope {slope:+.1f} KiB/min; {time_s[-1] - time_s[0]:.0f} s, {done}"  # fmt: skip
    return Figure(PART, f"growth of the {who}", "KiB", float(size_kib[-1] - size_kib[0]), target=target, note=note)
