"""Runs of the real daemon without a gateway: the bench is the only client, over the shared memory itself."""

import contextlib
import io
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from hal.errors import RtctlError
from rtctl import robots
from rtctl.commands import Verb
from rtctl.daemon import Daemon
from rtctl.exchange.control import RealTimeState, Word, get
from rtctl.exchange.mailbox import stage
from rtctl.exchange.ring import RingReader
from rtctl.gateway.commander import VERDICT_S, Commander
from rtctl.planner import make_plan
from rtctl.settings import Settings
from rtctl.workflow import Cause, Predicate, conditions_of

GLANCE_S = 0.02
VALID_S = 0.5


class BenchError(RtctlError):
    """A run of the bench did not do what it was started for."""


class BenchOperator:
    """A :class:`rtctl.workflow.Operator` that keeps every record it sees."""

    def __init__(self, daemon: Daemon) -> None:
        self._daemon, settings = daemon, daemon.settings
        self.control = daemon.control
        self.robot = robots.load(settings.robot.kind, settings.robot.geometry)
        self._commander = Commander(daemon.segment, settings.loop.period_s)
        self._ring = RingReader(daemon.segment.records, daemon.segment.layout.record, limit=4096)
        self._rows: list[np.ndarray] = []
        self._plans = 0

    def command(self, verb: Verb, *arguments: float, slot: int = 0) -> int:
        """Post a command and wait for its verdict. Raises Refusal if it is not accepted."""
        now_s = time.monotonic()
        future = self._commander.post(verb, arguments, "bench", VALID_S, now_s, slot)
        while not future.done():
            time.sleep(0.001)
            self.glance()
            self._commander.expire(time.monotonic())
        return future.result(VERDICT_S)

    def wait(self, until: Predicate, timeout_s: float) -> Any:
        """Look at the records until `until` holds for the newest, `timeout_s` are over, or the loop has ended."""
        end_s = time.monotonic() + timeout_s
        while True:
            row = self.glance()
            over = time.monotonic() > end_s or get(self._daemon.control, Word.REAL_TIME_STATE) >= RealTimeState.STOPPED
            if over or (row is not None and until(row)):
                return row
            time.sleep(GLANCE_S)

    def plan(self, progress: Callable[[float], None]) -> int:
        """Plan from the registered entry and load the plan."""
        self._plans += 1
        entry = self._rows[-1][-1]["pose_entry"]
        path = make_plan(self._daemon.settings, self.robot, entry, self._plans, lambda n, of: progress(n / of))
        slot = int(stage(self._daemon.segment.plans, self._plans, path[0]))
        return self.command(Verb.LOAD_PLAN, float(self._plans), slot=slot)

    def causes(self, record: Any) -> list[Cause]:
        """Conditions by name; the bench has no operator to talk to."""
        return [Cause(condition.name, "see the condition table") for condition in conditions_of(record)]

    def glance(self) -> Any:
        """Take what is new in the ring; the newest record, None before the first."""
        while len(rows := self._ring.read()):
            self._rows.append(rows.copy())
            self._commander.resolve(rows)
        return self._rows[-1][-1] if self._rows else None

    def records(self) -> np.ndarray:
        """All records so far. Raises BenchError if some were overwritten before they were seen."""
        self.glance()
        if self._ring.lost or not self._rows:
            raise BenchError("records were lost", value=self._ring.lost, bound="0", remedy="relieve the machine")
        return np.concatenate(self._rows)


def records_of(settings: Settings, script: Callable[[BenchOperator], object]) -> np.ndarray:
    """Run the daemon without a gateway while `script` operates it; all records (n,) of the run.

    Raises:
        BenchError: the daemon ended badly, or records were lost. What `script` raises comes out, too.
    """
    operators = []

    def operate(daemon: Daemon) -> None:
        operators.append(BenchOperator(daemon))
        script(operators[0])

    run_daemon(settings, operate, gateway=False)
    return operators[0].records()


def run_daemon(settings: Settings, operate: Callable[[Daemon], object], *, gateway: bool) -> None:
    """Run the daemon until `operate`, in a thread beside it, is done.

    Raises:
        BenchError: the daemon ended badly. What `operate` raises comes out, too.
    """
    with (
        tempfile.TemporaryDirectory() as directory,
        _signals_restored(),
        contextlib.redirect_stdout(io.StringIO()),
        ThreadPoolExecutor(1) as beside,
    ):
        daemon = Daemon(settings, run_directory=Path(directory), seed=1, gateway=gateway)
        operating = beside.submit(
            _operate_when_ready, daemon, operate, Word.GATEWAY_HEARTBEAT if gateway else Word.TICK
        )
        code = daemon.run()
        if not operating.done():
            raise KeyboardInterrupt  # the daemon was told to end, and it was not by `operate`
        operating.result()
    if code != 0:
        raise BenchError("the daemon failed", value=code, bound="exit code 0", remedy="see its messages above")


def _operate_when_ready(daemon: Daemon, operate: Callable[[Daemon], object], sign_of_life: Word) -> None:
    """Call `operate` once the loop ticks, or the gateway answers; not at all if the daemon gives up before."""
    try:
        while get(daemon.control, sign_of_life) == 0:
            if daemon.stopping_since is not None or (
                daemon.real_time is not None and daemon.real_time.poll() is not None
            ):
                return
            time.sleep(GLANCE_S)
        operate(daemon)
    finally:
        daemon.stop()


@contextlib.contextmanager
def _signals_restored() -> Iterator[None]:
    """Ctrl-C and SIGTERM end the bench again after a daemon has used them for itself."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
