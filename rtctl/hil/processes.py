"""The emulated bench as processes of its own: the plant with what is wired to it, and every device on a link."""

import json
import selectors
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from hal import emulator as emulators
from hal.backend import load
from hal.errors import BackendError, OptionError
from rtctl.hil.insertion import in_lockstep
from rtctl.settings import Settings
from rtctl.warmup import warm_up_apart

PLANT = "plant"
START_S = 60.0
END_S = 5.0


def rig_settings(settings: Settings, seed: int) -> dict[str, Any]:
    """What the processes of the bench are told.

    Raises:
        OptionError: the settings have no devices on an emulated bench.
    """
    options = settings.backend.options
    seams, _, place = str(options.get("seams", "")).partition(":")
    if settings.backend.name != "hardware" or seams != "rig":
        raise OptionError("these settings have no emulated bench", value=f"backend {settings.backend.name}, seams {seams or 'absent'}", bound='backend hardware, seams "rig"', remedy="take config planar-hil")  # fmt: skip
    backend = load("hardware", options, period_s=settings.loop.period_s, seed=seed)
    return {
        "place": place or "bench", "period_s": settings.loop.period_s, "seed": seed, "axes": backend.axes,
        "devices": list(options["devices"]), "rig": options.get("rig", {}),
    }  # fmt: skip


def parts(told: dict[str, Any]) -> list[str]:
    """Names of the processes: the plant, then every device that lives apart."""
    apart = [e["name"] for e in told["devices"] if emulators.load(str(e["kind"])).apart]
    return [PLANT, *apart]


class RigProcesses:
    """The bench, started and ended with a context.

    Args:
        settings: of the backend "hardware" with seams "rig".
        seed: of the plant.
        output: file that takes what the processes say.

    Raises:
        OptionError: the settings have no emulated bench. BackendError: a process did not come up.
    """

    def __init__(self, settings: Settings, seed: int, output: Path) -> None:
        self._settings, self._told = settings, rig_settings(settings, seed)
        self._output = output
        self.processes: dict[str, subprocess.Popen] = {}

    def __enter__(self) -> Self:
        warm_up_apart(in_lockstep(self._settings))
        try:
            for part in parts(self._told):
                self.processes[part] = self._start(part)
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def check(self) -> None:
        """Raises BackendError if a process of the bench has died."""
        for part, process in self.processes.items():
            if process.poll() is not None:
                raise BackendError("a part of the emulated bench has died", value=f"{part}: exit {process.returncode}", remedy=f"see {self._output}")  # fmt: skip

    def _start(self, part: str) -> subprocess.Popen:
        command = [sys.executable, "-m", "sim_backends.rig.process", part]
        with self._output.open("ab") as output:
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=output, start_new_session=True)  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(self._told).encode())
        process.stdin.close()
        if not _says_ready(process.stdout):
            process.terminate()
            process.wait(END_S)
            raise BackendError("a part of the emulated bench did not start", value=part, bound=f"within {START_S:g} s", remedy=f"see {self._output}")  # fmt: skip
        return process

    def _end(self) -> None:
        for process in reversed(self.processes.values()):
            process.terminate()
        for process in self.processes.values():
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _says_ready(stream: IO[bytes]) -> bool:
    """True once a line comes; False at the end of the stream or after START_S."""
    with selectors.DefaultSelector() as selector:
        selector.register(stream, selectors.EVENT_READ)
        end = time.monotonic() + START_S
        while (left := end - time.monotonic()) > 0:
            if selector.select(left):
                return stream.readline().strip() == b"ready"
    return False
