"""A real daemon on a free port, for tests that break it."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from rtctl.client import Client, NoReply
from rtctl.log.reader import Log, open_many

PATIENT = ("backend.options.watchdog_ticks=2000", "safety.overrun_ticks=1000", "safety.overrun_share=1.0")
"""A shared machine stalls as it likes; only the test that freezes the loop on purpose is about that."""

SCRIPT = """
import sys
from pathlib import Path
from hal.errors import RtctlError
from rtctl import daemon
from rtctl.settings import load
try:
    sys.exit(daemon.run(load("planar-sim", sys.argv[2:]), run_directory=Path(sys.argv[1]), seed=7))
except RtctlError as error:
    print(error, file=sys.stderr)
    sys.exit(error.exit_code)
"""


class DaemonUnderTest:
    """`rtctl run` without the command line: start, find its processes, hurt them, read what it left."""

    def __init__(self, directory: Path, *overrides: str, name: str | None = None) -> None:
        self.directory = directory
        self.name = name or f"test{os.getpid()}-{directory.name}"
        self.endpoint = free_endpoint()
        arguments = [f"robot.name={self.name}", f"gateway.endpoint={self.endpoint}", *PATIENT, *overrides]
        self.process = subprocess.Popen(
            [sys.executable, "-c", SCRIPT, str(directory), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            process_group=0,
        )

    def wait_until_ready(self) -> "DaemonUnderTest":
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if "is running" in line:
                return self
        raise AssertionError(f"the daemon ended with {self.process.wait()}")

    def client(self, source: str = "test") -> Client:
        return Client(robot=self.name, endpoint=self.endpoint, source=source)

    def client_again(self, timeout_s: float = 15.0) -> Client:
        """A client of a gateway that is just being restarted."""
        end = time.monotonic() + timeout_s
        while True:
            try:
                return self.client()
            except NoReply:
                if time.monotonic() > end:
                    raise

    def child(self, module: str) -> int:
        """Process id of the child that runs `module`, the newest if there were several; -1 for none."""
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
                    line = (entry / "cmdline").read_text().split("\0")
                except OSError:
                    continue
                if parent == self.process.pid and module in line:
                    found.append(int(entry.name))
        return max(found, default=-1)

    def terminate(self) -> int:
        """SIGTERM to the supervisor; its exit code."""
        self.process.send_signal(signal.SIGTERM)
        return self.wait()

    def wait(self, timeout_s: float = 30.0) -> int:
        try:
            self.output = self.process.communicate(timeout=timeout_s)[0]
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        return self.process.returncode

    def log(self) -> Log:
        return open_many(sorted(self.directory.glob("log*.mcap"), key=lambda p: (len(p.name), p.name)))

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()  # its children follow: they asked for a signal when their parent dies
            self.process.wait()


def free_endpoint() -> str:
    """A locator on loopback that nobody uses."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{s.getsockname()[1]}"


def eventually(holds, timeout_s: float = 10.0, what: str = "") -> None:
    """Wait until `holds()`; a test that waits too long fails with `what`."""
    end = time.monotonic() + timeout_s
    while not holds():
        assert time.monotonic() < end, f"not in time: {what}"
        time.sleep(0.02)
