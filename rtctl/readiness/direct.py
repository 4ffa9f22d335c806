"""Runs of the real daemon without a gateway: whoever measures is the only client, over the shared memory itself."""

import contextlib
import io
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

import numpy as np

from hal.errors import RtctlError
from rtctl import robots
from rtctl.commands import CommandRefused, Verb
from rtctl.daemon import Daemon
from rtctl.exchange.control import RealTimeState, Word, get
from rtctl.exchange.mailbox import stage
from rtctl.exchange.ring import RingReader
from rtctl.gateway.commander import VERDICT_S, Commander
from rtctl.gateway.refusal import Refusal
from rtctl.planner import make_plan
from rtctl.settings import Settings
from rtctl.workflow import Cause, Predicate, conditions_of

GLANCE_S = 0.02
VALID_S = 0.5


class RunError(RtctlError):
    """A run did not do what it was started for."""


class DirectOperator:
    """A :class:`rtctl.workflow.Operator` that shows every record it sees.

    Args:
        daemon: whose loop runs.
        see: is given all records in blocks (n,), in order, n is 0 where nothing is new, and the number in the ring of
            the record after them.
        glance_s: time between two looks at the ring.
    """

    def __init__(self, daemon: Daemon, see: Callable[[np.ndarray, int], object], glance_s: float = GLANCE_S) -> None:
        self._daemon, settings = daemon, daemon.settings
        self._glance_s = glance_s
        self.robot = robots.load(settings.robot.kind, settings.robot.geometry)
        self._commander = Commander(daemon.segment, settings.loop.period_s)
        self._ring = RingReader(daemon.segment.records, daemon.segment.layout.record, limit=4096)
        self._see = see
        self._newest: Any = None
        self._plans = 0

    def command(self, verb: Verb, *arguments: float, slot: int = 0) -> int:
        """Post a command and wait for its verdict. Raises CommandRefused if it is not accepted."""
        try:
            future = self._commander.post(verb, arguments, "direct", VALID_S, time.monotonic(), slot)
            while not future.done():
                time.sleep(0.001)
                self.glance()
                self._commander.expire(time.monotonic())
            return future.result(VERDICT_S)
        except Refusal as refusal:
            what = f"{verb.name.lower()} refused: {refusal.text}"
            raise CommandRefused(refusal.reason, what, remedy=refusal.remedy) from None

    def wait(self, until: Predicate, timeout_s: float) -> Any:
        """Look at the records until `until` holds for the newest, `timeout_s` are over, or the loop has ended."""
        end_s = time.monotonic() + timeout_s
        while True:
            row = self.glance()
            if time.monotonic() > end_s or self._has_ended() or (row is not None and until(row)):
                return row
            time.sleep(self._glance_s)

    def _has_ended(self) -> bool:
        """The loop is over, or its process is gone."""
        process = self._daemon.real_time
        stopped = get(self._daemon.control, Word.REAL_TIME_STATE) >= RealTimeState.STOPPED
        return stopped or (process is not None and process.poll() is not None)

    def plan(self, progress: Callable[[float], None]) -> int:
        """Plan from the registered entry and load the plan."""
        self._plans += 1
        entry = self._newest["pose_entry"]
        path = make_plan(self._daemon.settings, self.robot, entry, self._plans, lambda n, of: progress(n / of))
        slot = int(stage(self._daemon.segment.plans, self._plans, path[0]))
        return self.command(Verb.LOAD_PLAN, float(self._plans), slot=slot)

    def causes(self, record: Any) -> list[Cause]:
        """Conditions by name; there is no operator to talk to."""
        return [Cause(condition.name, "see the condition table") for condition in conditions_of(record)]

    def glance(self) -> Any:
        """Take what is new in the ring; the newest record, None before the first."""
        while True:
            rows = self._ring.read()
            self._see(rows, self._ring.position)
            if not len(rows):
                return self._newest
            self._newest = rows[-1].copy()
            self._commander.resolve(rows)

    @property
    def lost(self) -> int:
        """Records that were overwritten before they were seen."""
        return self._ring.lost


def run_daemon(settings: Settings, operate: Callable[[Daemon], object], *, gateway: bool) -> None:
    """Run the daemon until `operate`, in a thread beside it, is done.

    Raises:
        RunError: the daemon ended badly. What `operate` raises comes out, too.
        KeyboardInterrupt: the daemon was told to end, and it was not by `operate`.
    """
    ended_by_us: list[bool] = []
    with (
        tempfile.TemporaryDirectory() as directory,
        _signals_restored(),
        contextlib.redirect_stdout(io.StringIO()),
        ThreadPoolExecutor(1) as beside,
    ):
        daemon = Daemon(settings, run_directory=Path(directory), seed=1, gateway=gateway)
        sign_of_life = Word.GATEWAY_HEARTBEAT if gateway else Word.TICK
        operating = beside.submit(_operate_when_ready, daemon, operate, sign_of_life, ended_by_us)
        code = daemon.run()
        wait([operating])
        if not ended_by_us and not (gateway and code):  # a gateway that dies too often ends a daemon, too
            raise KeyboardInterrupt
        operating.result()
    if code != 0:
        raise RunError("the daemon failed", value=code, bound="exit code 0", remedy="see its messages above")


def _operate_when_ready(
    daemon: Daemon, operate: Callable[[Daemon], object], sign_of_life: Word, ended_by_us: list[bool]
) -> None:
    """Call `operate` once the loop ticks, or the gateway answers; not at all if the daemon gives up before.

    ended_by_us: gets an entry unless somebody else has told the daemon to end before.
    """
    try:
        while get(daemon.control, sign_of_life) == 0:
            if daemon.stopping_since is not None or (
                daemon.real_time is not None and daemon.real_time.poll() is not None
            ):
                return
            time.sleep(GLANCE_S)
        operate(daemon)
    finally:
        if daemon.stopping_since is None:
            ended_by_us.append(True)
        daemon.stop()


@contextlib.contextmanager
def _signals_restored() -> Iterator[None]:
    """Ctrl-C and SIGTERM end the caller again after a daemon has used them for itself."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
