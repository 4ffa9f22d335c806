"""Compile every kernel into the cache, so that a real-time process never compiles: at install, and before a daemon."""

import os
import subprocess
import sys

from hal.backend import load
from hal.errors import RtctlError
from hal.kernel import CacheError, cache_directory, compiled_here
from rtctl.controller import Controller
from rtctl.handover import layout, read_settings, write_settings
from rtctl.rehearsal import rehearse
from rtctl.settings import Settings

DONE = "complete"


def is_warm(settings: Settings) -> bool:
    """True if a warm-up for this robot and backend has filled the cache of the present kernels."""
    return (cache_directory() / f"{settings.robot.kind}-{settings.backend.name}.{DONE}").exists()


def warm_up(settings: Settings) -> list[str]:
    """Compile what is missing, in this process; returns the names of the kernels that were compiled.

    Raises:
        CacheError: the cache cannot be written, so the real-time process would have to compile, too.
    """
    choice = settings.backend
    backend = load(choice.name, choice.options, period_s=settings.loop.period_s, seed=0)
    rehearse(settings, backend)
    if backend.simulated:
        _exercise_device(backend, settings)
    _exercise_gateway(backend, settings)
    try:
        cache_directory().mkdir(parents=True, exist_ok=True)
        (cache_directory() / f"{settings.robot.kind}-{choice.name}.{DONE}").touch()
    except OSError as error:
        raise CacheError(error) from None
    return compiled_here()


def warm_up_apart(settings: Settings) -> None:
    """The same in a process of its own, so that the caller and its children load instead of compiling."""
    if is_warm(settings):
        return
    print("rtctl: compiling the kernels, once for this version; about a minute", file=sys.stderr, flush=True)
    fd = write_settings(settings)
    try:
        command = [sys.executable, "-m", "rtctl.warmup", str(fd)]
        subprocess.run(command, pass_fds=[fd], check=True)
    except subprocess.CalledProcessError as error:
        raise RtctlError("compiling the kernels failed", value=error.returncode, remedy="see the message above") from None  # fmt: skip
    finally:
        os.close(fd)


def _exercise_device(backend, settings: Settings) -> None:
    """A simulated device may be touched: a few ticks through the compiled loop of lockstep runs, too."""
    from rtctl.lockstep import Lockstep  # only here: a backend of hardware never runs in lockstep

    lockstep = Lockstep(settings, 0)
    lockstep.advance(2)
    backend.read(0, lockstep.controller.sensors)
    backend.write(0, lockstep.controller.actuators)


def _exercise_gateway(backend, settings: Settings) -> None:
    """A gateway that compiles when it starts takes longer than the ring of records lasts."""
    from rtctl.gateway.setup import exercise  # only here: it brings the science libraries along

    controller = Controller(settings)
    exercise(settings, controller.robot, layout(controller, backend))


if __name__ == "__main__":
    try:
        warm_up(read_settings(int(sys.argv[1])))
    except RtctlError as problem:
        print(f"rtctl: {problem}", file=sys.stderr)
        sys.exit(problem.exit_code)
