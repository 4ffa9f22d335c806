"""Carries out a soak: storms and an operator against a daemon, gateways killed by their number, everything noted."""

import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh

from hal.errors import RtctlError
from rtctl.client import Client
from rtctl.commands import CommandRefused
from rtctl.settings import Settings
from rtctl.soak.operator import RandomOperator
from rtctl.soak.processes import Sample, children, sample, size_bytes

STORMS = 2
SAMPLE_S = 0.5
KILL_EVERY_S = (13.0, 25.0)
"""Drawn between these: the daemon gives up on a gateway that dies more than five times a minute."""
SETTLING_S = 2.0
"""After an outage: a client has to find the new gateway."""
BACK_S = 30.0


class SoakError(RtctlError):
    """The soak could not be carried out to its end."""


@dataclass(frozen=True)
class Outage:
    """A gateway was killed and another one answered: Unix times [ns]."""

    killed_ns: int
    back_ns: int

    def covers(self, sent_ns: int, given_up_ns: int) -> bool:
        """Whether a request that waited from then until then may have got lost in it."""
        return sent_ns <= self.back_ns + round(1e9 * SETTLING_S) and given_up_ns >= self.killed_ns


@dataclass
class Noted:
    """What was seen from outside while the daemon ran."""

    seed: int
    seconds: float = 0.0
    outages: list[Outage] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    disk: list[tuple[float, int]] = field(default_factory=list)
    """(time [s], size [bytes]) of the folder of the run"""
    storms: list[dict[str, Any]] = field(default_factory=list)
    outcomes: dict[str, int] = field(default_factory=dict)
    """"verb: what came of it" -> times, of the operator"""
    operator_unanswered_ns: list[tuple[int, int]] = field(default_factory=list)
    status: dict[str, Any] = field(default_factory=dict)
    """the last one"""
    gateways: set[int] = field(default_factory=set)


def carry_out(
    settings: Settings, supervisor: int, directory: Path, seconds: float, seed: int, report: Callable[[str], None]
) -> Noted:
    """Soak the ready daemon of `settings` for so many seconds; it goes on running afterwards.

    Args:
        supervisor: process id of the daemon.
        directory: its run folder.
        report: is told every half minute how it goes.

    Raises:
        SoakError: a killed gateway did not come back, or the daemon died.
    """
    noted = Noted(seed)
    draw = random.Random(seed)
    operator = RandomOperator(settings, draw.getrandbits(32))
    acting = threading.Thread(target=operator.run, name="operator")
    storms = [_storm(settings, draw.getrandbits(32)) for _ in range(STORMS)]
    begun = time.monotonic()
    try:
        acting.start()
        _watch(noted, settings, supervisor, directory, begun + seconds, draw, report)
    finally:
        operator.stopping.set()
        noted.storms = [json.loads(storm.communicate(timeout=BACK_S)[0] or "{}") for storm in storms]
        acting.join()
    noted.seconds = time.monotonic() - begun
    noted.outcomes = {f"{what}: {outcome}": n for (what, outcome), n in sorted(operator.outcomes.items())}
    noted.operator_unanswered_ns = operator.unanswered_ns
    noted.status = _status(settings) or {}
    return noted


def _storm(settings: Settings, seed: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "rtctl.soak.storm", "--robot", settings.robot.name, "--endpoint", settings.gateway.endpoint]  # fmt: skip
    command += ["--seed", str(seed)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)


def _watch(
    noted: Noted, settings: Settings, supervisor: int, directory: Path, end: float, draw: random.Random, report: Callable[[str], None],
) -> None:  # fmt: skip
    """Sample the processes, and kill a gateway now and then, until `end`."""
    left = end - time.monotonic()
    next_kill = time.monotonic() + min(draw.uniform(*KILL_EVERY_S), 0.4 * left)
    next_report = time.monotonic() + 30.0
    while (now := time.monotonic()) < end:
        living = children(supervisor)
        if "real-time" not in living:
            raise SoakError("the real-time process has ended", remedy=f"see {directory}")
        noted.gateways |= {living["gateway"]} if "gateway" in living else set()
        noted.samples += [seen for role, pid in living.items() if (seen := sample(role, pid)) is not None]
        noted.disk.append((now, size_bytes(directory)))
        if now >= next_kill and "gateway" in living and end - now > 2 * SETTLING_S:
            noted.outages.append(_kill(settings, living["gateway"]))
            next_kill = time.monotonic() + draw.uniform(*KILL_EVERY_S)
        if now >= next_report:
            next_report += 30.0
            report(f"{(end - now) / 60.0:6.1f} min left, {len(noted.outages)} gateways killed, {noted.disk[-1][1] / 1e6:.0f} MB logged")  # fmt: skip
        time.sleep(SAMPLE_S)


def _kill(settings: Settings, gateway: int) -> Outage:
    """Kill a gateway, and wait for the next one to answer."""
    killed_ns, until = time.time_ns(), time.monotonic() + BACK_S
    os.kill(gateway, signal.SIGKILL)
    while time.monotonic() < until:
        if _status(settings) is not None:
            return Outage(killed_ns, time.time_ns())
        time.sleep(0.05)
    raise SoakError("no gateway came after the one that was killed", bound=f"within {BACK_S:g} s")


def _status(settings: Settings) -> dict[str, Any] | None:
    """What the gateway says of itself: empty if it is too busy to, None if nobody answers."""
    gateway = settings.gateway
    try:
        with Client(settings.robot.name, gateway.endpoint, "soak-watch", user=gateway.user, password=gateway.password) as client:  # fmt: skip
            return client.status()
    except CommandRefused:
        return {}
    except (RtctlError, zenoh.ZError):
        return None
