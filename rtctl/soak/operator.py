"""An operator without a plan: every verb in any order, with arguments that make sense or do not, and parameter sets."""

import random
import threading
import time
from collections import Counter
from typing import Any

import numpy as np
import zenoh

from hal.errors import RtctlError
from rtctl.client import Client, NoReply
from rtctl.commands import CommandRefused, Verb
from rtctl.gateway.keys import ALONG_PATH, MOTION_OF_POSE, STAGED
from rtctl.lifecycle import Operating, Task
from rtctl.settings import Settings

RETRY_S = 0.1
TIMEOUT_S = 5.0
"""Beside a storm an answer may take two seconds."""
LONGEST_REST_S = 0.3
NEAR = 0.2
"""Of a pose [mm, rad]: good enough to register the entry there."""
RECOVERY: dict[int, Verb] = {
    Operating.PAUSED: Verb.RESUME,
    Operating.FAULT: Verb.ACKNOWLEDGE,
    Operating.DISABLED: Verb.ENABLE,
}
"""What leads on towards a robot that moves; without it a random walk spends its time in FAULT."""
SWAPPED: dict[str, tuple[float, float]] = {
    "admittance.lateral_gain_mm_per_n_s": (0.0, 40.0),
    "admittance.deadband_n": (0.01, 0.1),
    "wrench.cutoff_hz": (5.0, 40.0),
    "trajectory.speed_mm_per_s": (4.0, 15.0),
    "control.integral_limit_v": (1.0, 4.0),
}
"""Live options and the range in which the robot still works."""


class RandomOperator:
    """Gives commands until told to stop. Counts are in `outcomes`: (what was asked, what came of it) -> times."""

    def __init__(self, settings: Settings, seed: int) -> None:
        self._settings, self._random = settings, random.Random(seed)
        self._client: Client | None = None
        self.outcomes: Counter[tuple[str, str]] = Counter()
        self.unanswered_ns: list[tuple[int, int]] = []
        """Unix times from sending to giving up, of requests that got no reply"""
        self.stopping = threading.Event()

    def run(self) -> None:
        """Act until `stopping` is set."""
        try:
            while not self.stopping.is_set():
                if self._connected():
                    self._act()
                    self.stopping.wait(self._random.uniform(0.0, LONGEST_REST_S))
        finally:
            self._leave()

    def _connected(self) -> bool:
        if self._client is None:
            gateway = self._settings.gateway
            try:
                self._client = Client(self._settings.robot.name, gateway.endpoint, "soak", TIMEOUT_S, user=gateway.user, password=gateway.password)  # fmt: skip
            except NoReply:
                time.sleep(RETRY_S)
        return self._client is not None

    def _leave(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def _act(self) -> None:
        assert self._client is not None
        draw, client = self._random, self._client
        record = client.latest()
        kind = draw.random()
        if kind < 0.5 and record is not None:
            self._lead_on(client, record)
        elif kind < 0.6:
            self._ask("move_cp", client.command, Verb.MOVE_CP, *self._pose())
        elif kind < 0.65:
            for _ in range(20):
                self._ask("servo_cv", client.command, Verb.SERVO_CV, *(draw.uniform(-2.0, 2.0) for _ in range(2)), 0.0)
        elif kind < 0.75:
            low, high = SWAPPED[name := draw.choice(list(SWAPPED))]
            value = draw.uniform(low, high) if draw.random() < 0.8 else -1e6
            self._ask("param/set", client.set_parameters, {name: value})
        else:
            verb = draw.choice([v for v in Verb if v is not Verb.NONE and v not in STAGED])
            self._ask(verb.name.lower(), client.command, verb, *self._arguments(verb))

    def _lead_on(self, client: Client, record: Any) -> None:
        """The next step on the way into the cochlea, as the work-flow would do it."""
        state, task = int(record["operating_state"]), int(record["task_state"])
        entry = np.array(self._settings.workflow.entry_pose_mm_rad)
        registered, there = (np.abs(record[name] - entry).max() < NEAR for name in ("pose_entry", "pose_measured"))
        loaded = bool(record["array_loaded"])
        steps: list[tuple[bool, Verb]] = [
            (loaded and not (record["is_homed"] and registered), Verb.UNLOAD_ARRAY),
            (not record["is_homed"], Verb.HOME),
            (not registered, Verb.REGISTER_ENTRY if there else Verb.MOVE_CP),
            (not loaded, Verb.LOAD_ARRAY),
            (not record["is_unbiased"], Verb.UNBIAS),
            (not record["plan_number"], Verb.LOAD_PLAN),
            (task == Task.AT_ENTRY, Verb.INSERT),
            (task == Task.HOLDING, Verb.RETRACT),
            (True, Verb.APPROACH),
        ]
        verb = RECOVERY.get(state) or next(verb for due, verb in steps if due)
        if verb is Verb.LOAD_PLAN:
            self._ask("plan", client.plan)
        elif verb in RECOVERY.values() or not record["is_busy"]:
            known = {Verb.INSERT: [6.0, 2.0], Verb.RETRACT: [0.0, 3.0], Verb.MOVE_CP: entry.tolist()}
            arguments: list[float] = known.get(verb, [])
            self._ask(verb.name.lower(), client.command, verb, *arguments)

    def _pose(self) -> list[float]:
        """Somewhere in the workspace, or nowhere."""
        aside = np.array(self._settings.workflow.retracted_pose_mm_rad)
        return (aside + np.array([self._random.gauss(0.0, s) for s in (8.0, 4.0, 0.05)])).tolist()

    def _arguments(self, verb: Verb) -> list[float]:
        if self._random.random() < 0.2:
            return [self._random.uniform(-1e4, 1e4) for _ in range(self._random.randrange(8))]
        if verb in MOTION_OF_POSE:
            return self._pose()
        return [self._random.uniform(-1.0, 16.0), self._random.uniform(0.0, 4.0)] if verb in ALONG_PATH else []

    def _ask(self, what: str, request: Any, *arguments: Any) -> None:
        """One request, and what came of it."""
        if self._client is None:
            return
        begun_ns = time.time_ns()
        try:
            request(*arguments)
            self.outcomes[what, "accepted"] += 1
        except CommandRefused as refused:
            self.outcomes[what, refused.reason] += 1
        except (RtctlError, zenoh.ZError):
            self.outcomes[what, "unanswered"] += 1
            self.unanswered_ns.append((begun_ns, time.time_ns()))
            self._leave()
