"""The supervisor: owns the shared memory, starts the real-time process and the gateway, and looks after both.

The gateway is restarted when it dies; the real-time process never is, because a robot must not come back to life by
itself. systemd talks to this process: it is ready when the loop runs and the gateway answers, and it feeds the
watchdog only while the loop makes progress.
"""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import sdnotify

from hal.backend import load
from hal.errors import RtctlError
from rtctl.controller import Controller
from rtctl.exchange.control import Grade, RealTimeState, Word, get, put
from rtctl.exchange.segment import Segment
from rtctl.handover import layout, write_settings
from rtctl.settings import Settings
from rtctl.warmup import warm_up_apart

START_LIMIT_S = 60.0
STOP_LIMIT_S = 15.0
GATEWAY_RESTARTS = 5
"""Restarts allowed within a minute; a gateway that dies more often has a reason that restarting does not cure."""
SINGLE_THREADED = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class AlreadyRunningError(RtctlError):
    """Another daemon holds this robot."""

    exit_code = 3


class Daemon:
    """One run of the controller, from the claim on the robot to the last line of the log."""

    def __init__(
        self, settings: Settings, *, run_directory: Path, seed: int, gateway: bool, duration_s: float | None = None
    ) -> None:
        self.settings, self.run_directory, self.seed = settings, run_directory, seed
        self.with_gateway = gateway
        self.ticks = None if duration_s is None else round(duration_s / settings.loop.period_s)
        self.claim = claim(settings.robot.name)
        warm_up_apart(settings)
        choice = settings.backend
        backend = load(choice.name, choice.options, period_s=settings.loop.period_s, seed=seed)
        self.segment = Segment.create(layout(Controller(settings), backend))
        self.control = self.segment.control
        self.settings_fd = write_settings(settings)
        self.notifier = sdnotify.SystemdNotifier()
        self.stopping_since: float | None = None
        self.gateway_starts: list[float] = []
        self.gateway: subprocess.Popen | None = None
        self.real_time: subprocess.Popen | None = None

    def run(self) -> int:
        """Run until asked to stop or until the real-time process ends. Returns the exit code of the daemon."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: self.stop())
        self.run_directory.mkdir(parents=True, exist_ok=True)
        self.real_time = self._start("rtctl.realtime", *(["--ticks", str(self.ticks)] if self.ticks else []))
        try:
            self._wait_until_ready()
            self._watch()
        finally:
            self._end()
        return self._exit_code()

    def stop(self) -> None:
        """Ask the loop to come to rest, remove power and end; safe to call from a signal handler."""
        put(self.control, Word.STOP_REQUEST, 1)
        if self.stopping_since is None:
            self.stopping_since = time.monotonic()

    def _start(self, module: str, *extra: str) -> subprocess.Popen:
        fds = (self.segment.fd, self.settings_fd)
        command = [sys.executable, "-m", module, "--memory-fd", str(fds[0]), "--settings-fd", str(fds[1])]
        command += ["--seed", str(self.seed), "--run-directory", str(self.run_directory), *extra]
        # a process group of its own: Ctrl-C reaches the supervisor, which ends its children in order
        return subprocess.Popen(command, pass_fds=fds, env=os.environ | SINGLE_THREADED, process_group=0)

    def _start_gateway(self) -> None:
        self.gateway = self._start("rtctl.gateway")
        self.gateway_starts.append(time.monotonic())
        put(self.control, Word.GATEWAY_PID, self.gateway.pid)

    def _wait_until_ready(self) -> None:
        """Wait for the loop, then for the gateway's first heartbeats."""
        assert self.real_time is not None
        limit = time.monotonic() + START_LIMIT_S
        while get(self.control, Word.REAL_TIME_STATE) < RealTimeState.RUNNING:
            if self.real_time.poll() is not None or self.stopping_since is not None:
                return
            self._within(limit, "the real-time process did not get ready")
        if self.with_gateway:
            self._start_gateway()
            while get(self.control, Word.GATEWAY_HEARTBEAT) == 0:
                self._keep_gateway()
                if self.real_time.poll() is not None or self.stopping_since is not None:
                    return
                self._within(limit, "the gateway did not get ready")
            put(self.control, Word.GATEWAY_EXPECTED, 1)  # from here on its silence is a condition
        grade = Grade(get(self.control, Word.GRADE)).name.lower().replace("_", "-")
        self.notifier.notify(f"READY=1\nSTATUS=running, grade {grade}")
        print(f"rtctl: {self.settings.robot.name} is running, grade {grade}, in {self.run_directory}", flush=True)

    def _within(self, limit: float, what: str) -> None:
        if time.monotonic() > limit:
            raise RtctlError(what, bound=f"within {START_LIMIT_S:g} s", remedy="see the messages above")
        time.sleep(0.02)

    def _watch(self) -> None:
        """Until the real-time process has ended: feed the watchdog on progress, restart a dead gateway."""
        assert self.real_time is not None
        last_tick, last_progress = -1, time.monotonic()
        while self.real_time.poll() is None:
            tick, now = get(self.control, Word.TICK), time.monotonic()
            if tick != last_tick:
                last_tick, last_progress = tick, now
                self.notifier.notify("WATCHDOG=1")
            self._keep_gateway()
            if self.stopping_since is not None and now - max(self.stopping_since, last_progress) > STOP_LIMIT_S:
                self.real_time.kill()  # stuck: the watchdog of the device has removed power long ago
            time.sleep(0.05)

    def _keep_gateway(self) -> None:
        """Start a dead gateway again, unless the daemon is ending or it dies too often."""
        if self.gateway is None or self.gateway.poll() is None or self.stopping_since is not None:
            return
        recent = [t for t in self.gateway_starts if time.monotonic() - t < 60.0]
        print(f"rtctl: the gateway ended with {self.gateway.returncode}", file=sys.stderr, flush=True)
        if len(recent) > GATEWAY_RESTARTS:
            print("rtctl: it ends too often; the robot holds, and the daemon stops", file=sys.stderr, flush=True)
            self.stop()
            return
        self._start_gateway()

    def _end(self) -> None:
        """Whatever happened: no loop without a supervisor, then let the gateway finish the log."""
        self.notifier.notify("STOPPING=1")
        if self.real_time is not None and self.real_time.poll() is None:
            self.stop()
            _wait_or_kill(self.real_time)
        if self.gateway is not None:
            _wait_or_kill(self.gateway)
        os.close(self.settings_fd)
        self.claim.close()

    def _exit_code(self) -> int:
        """0 after a safe end; 5 if the real-time process died; the gateway's own code if only its end was bad."""
        assert self.real_time is not None
        if get(self.control, Word.REAL_TIME_STATE) != RealTimeState.STOPPED:
            code = self.real_time.returncode
            print(f"rtctl: the real-time process died with {code}; the device's watchdog removed power", file=sys.stderr)  # fmt: skip
            return 5 if code < 0 or code == 0 else code
        return self.gateway.returncode if self.gateway is not None else 0


def run(
    settings: Settings, *, run_directory: Path, seed: int, gateway: bool = True, duration_s: float | None = None
) -> int:
    """Supervise one run; see :class:`Daemon`.

    Raises:
        AlreadyRunningError: a daemon for this robot is running on this machine.
    """
    return Daemon(settings, run_directory=run_directory, seed=seed, gateway=gateway, duration_s=duration_s).run()


def claim(robot: str) -> socket.socket:
    """Hold the robot's name as an abstract socket: it vanishes with the process, however that ends."""
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        claim.bind(f"\0rtctl-{robot}")
    except OSError:
        claim.close()
        raise AlreadyRunningError(
            "a daemon for this robot is already running",
            value=robot,
            remedy="stop it first (`rtctl status` shows it), or give this one another robot.name",
        ) from None
    return claim


def _wait_or_kill(process: subprocess.Popen) -> None:
    try:
        process.wait(STOP_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
