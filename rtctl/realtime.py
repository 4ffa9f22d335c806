"""The real-time process: one thread, one loop, nothing else. Started by :mod:`rtctl.daemon`."""

import argparse
import gc
import json
import os
import signal
import sys
from pathlib import Path

import numpy as np

from hal.backend import load
from hal.errors import BackendError, RtctlError
from hal.kernel import loaded
from rtctl import clock as clocks
from rtctl.controller import Controller
from rtctl.exchange.control import Grade, RealTimeState, Word, get, put
from rtctl.exchange.segment import Segment
from rtctl.handover import layout, read_settings
from rtctl.loop import Loop
from rtctl.machine import Machine, die_with_parent
from rtctl.rehearsal import rehearse

MACHINE_FILE = "machine.json"


def main() -> int:
    """Set up the machine, rehearse, run until asked to stop. Exit code 0 if it ended in the safe state."""
    parser = argparse.ArgumentParser(prog="rtctl.realtime", description=__doc__)
    parser.add_argument("--memory-fd", type=int, required=True)
    parser.add_argument("--settings-fd", type=int, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--run-directory", type=Path, required=True)
    parser.add_argument("--ticks", type=int)
    arguments = parser.parse_args()
    die_with_parent()
    try:
        return run(arguments)
    except RtctlError as error:
        print(f"rtctl: {error}", file=sys.stderr)
        return error.exit_code


def run(arguments: argparse.Namespace) -> int:
    """The process from its first line to its last; see :func:`main`."""
    settings = read_settings(arguments.settings_fd)
    choice = settings.backend
    backend = load(choice.name, choice.options, period_s=settings.loop.period_s, seed=arguments.seed)
    controller = Controller(settings)
    segment = Segment.attach(arguments.memory_fd, layout(controller, backend))
    control = segment.control
    put(control, Word.REAL_TIME_PID, os.getpid())
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: put(control, Word.STOP_REQUEST, 1))
    try:
        rehearse(settings, backend)
        backend.open()
        machine = Machine(settings.loop)
        grade = machine.grade()
        may_arm = backend.simulated or grade == Grade.RT or settings.loop.allow_best_effort
        backend.read(0, controller.sensors)  # the first call of a device may be slow
        backend.write(0, controller.actuators)
        if settings.loop.clock == "device" and not np.isfinite(controller.sensors["device_time_s"][0]):
            raise BackendError("no device tells its time, so none can pace the loop", value="loop.clock = device", bound="a device that measures time", remedy="set loop.clock to grid; the plant has a clock of its own with backend.options.crystal_ppm")  # fmt: skip
        loop = Loop(controller, backend, segment, settings.safety.heartbeat_ticks, may_arm)
        (arguments.run_directory / MACHINE_FILE).write_text(json.dumps(machine.as_table(), indent=1))
        put(control, Word.GRADE, grade)
        clock = clocks.make(settings.loop)
        put(control, Word.EPOCH_NS, int(clock["epoch_ns"][0]))
        put(control, Word.REAL_TIME_STATE, RealTimeState.RUNNING)
        rehearsed = loaded()
        count_collections(control)
        loop.run(clock, arguments.ticks)
        for name in sorted(loaded() - rehearsed):
            print(f"rtctl: loaded while the loop ran, because it was not rehearsed: {name}", file=sys.stderr)
    except BaseException:
        put(control, Word.REAL_TIME_STATE, RealTimeState.FAILED)
        raise
    finally:
        backend.close()
    put(control, Word.REAL_TIME_STATE, RealTimeState.STOPPED)
    return 0


def count_collections(control: np.ndarray) -> None:
    """Count what the garbage collector does from here on: nothing, unless somebody switches it on."""

    def count(phase: str, _info: dict[str, int]) -> None:
        if phase == "start":
            put(control, Word.GARBAGE_COLLECTIONS, get(control, Word.GARBAGE_COLLECTIONS) + 1)

    gc.callbacks.append(count)


if __name__ == "__main__":
    sys.exit(main())
