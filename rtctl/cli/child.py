"""A daemon started by a command and ended by it, whatever happens in between."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from hal.errors import RtctlError
from rtctl.cli.connection import ClientOperator
from rtctl.settings import Settings

if TYPE_CHECKING:
    from rtctl.client import Client

START_S = 300.0
"""The first start compiles every kernel."""
END_S = 30.0
POLL_S = 0.2
TAIL_LINES = 8


class DaemonError(RtctlError):
    """The daemon did not start, or not the way it should."""

    exit_code = 3


class Daemon:
    """``rtctl run`` as a child with a run folder of its own; a context manager.

    Attributes:
        output: file with what the daemon prints.
        exit_code: of the daemon, once the context is left.
    """

    def __init__(self, settings: Settings, config: str, overrides: list[str], seed: int, directory: Path) -> None:
        self.settings, self.directory = settings, directory
        self.output = directory / "daemon.txt"
        self.exit_code: int | None = None
        self._client: Client | None = None
        self._process: subprocess.Popen | None = None
        self._command = [sys.executable, "-m", "rtctl", "run", config, "--seed", str(seed)]
        self._command += ["--run-directory", str(directory)]
        for assignment in overrides:
            self._command += ["--set", assignment]

    def __enter__(self) -> Self:
        self.directory.mkdir(parents=True, exist_ok=True)
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # to be asked to end is no reason to leave it running
        with self.output.open("ab") as output:
            # a session of its own: Ctrl-C is for us, and we end it in order
            self._process = subprocess.Popen(
                self._command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._process is not None
        try:
            if self._client is not None:
                self._client.close()
        finally:
            self.exit_code = _end(self._process)

    @property
    def pid(self) -> int:
        """Process id of the supervisor."""
        assert self._process is not None
        return self._process.pid

    def operator(self) -> ClientOperator:
        """An operator for the daemon, once it is ready.

        Raises:
            DaemonError: it ended, or was not ready in time.
        """
        self.wait_until_ready()
        assert self._client is not None
        return ClientOperator(self._client)

    def wait_until_ready(self) -> None:
        """Return once the daemon answers and its loop runs.

        Raises:
            DaemonError: it ended, or was not ready in time.
        """
        end = time.monotonic() + START_S
        while time.monotonic() < end:
            assert self._process is not None
            if self._process.poll() is not None:
                code = self._process.returncode
                raise DaemonError(f"the daemon ended with {code}: {self._tail()}", remedy=f"see {self.output}")
            if self._is_ready():
                return
            time.sleep(POLL_S)
        raise DaemonError("the daemon is not ready", bound=f"within {START_S:g} s", remedy=f"see {self.output}")

    def _is_ready(self) -> bool:
        """True once our daemon, and not another one at the same endpoint, answers and its loop runs."""
        from rtctl.client import Client

        gateway = self.settings.gateway
        try:
            if self._client is None:
                self._client = Client(
                    self.settings.robot.name, gateway.endpoint, user=gateway.user, password=gateway.password
                )
            status = self._client.status()
        except RtctlError:
            return False
        ours = Path(status["log"]).resolve().parent == self.directory.resolve()
        return ours and status["real_time"] == "running" and self._client.latest() is not None

    def _tail(self) -> str:
        """The last lines the daemon has printed."""
        lines = self.output.read_text(errors="replace").splitlines()
        return " / ".join(line.strip() for line in lines[-TAIL_LINES:] if line.strip())


def _end(process: subprocess.Popen) -> int:
    """Ask the daemon to end safely, and see that it does."""
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
    try:
        return process.wait(END_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)  # the whole session: it has failed to end its own children
        return process.wait()
