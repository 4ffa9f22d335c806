"""One process of an emulated bench in real time: the plant with the devices wired to it, or one device on a link.

    python -m sim_backends.rig.process PART < settings.json

PART is "plant", or the name of a device that lives apart. Settings: {"place", "period_s", "seed", "devices", "rig"}, the last
two as in [backend.options]. It says "ready" once, and ends with SIGTERM. The bench has a clock of its own, as real devices
have: nothing ties its ticks to those of the loop.
"""

import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hal import emulator as emulators
from hal import options
from hal.emulator import Bench, Station
from hal.errors import BackendError, RtctlError
from sim_backends.rig import memory
from sim_backends.rig.backend import RigOptions
from sim_backends.rig.links import RealLinks
from sim_backends.rig.rig import Rig, add_emulator
from sim_backends.rig.seams import card_name

PLANT = "plant"


class RealStation(Station):
    """Where the emulators of this process live: cards in shared memory, links by real sockets."""

    def __init__(self, place: str, period_s: float, seed: int) -> None:
        self.links = RealLinks(place)
        super().__init__(period_s, seed, self.links)
        self.place = place
        self.names: list[str] = []

    def card_memory(self, base: int, dtype: np.dtype) -> np.ndarray:
        """See :class:`hal.emulator.Station`."""
        return self.share(card_name(base), dtype)

    def share(self, name: str, dtype: np.dtype) -> np.ndarray:
        """A record (1,) that the other processes see."""
        self.names.append(name)
        return memory.create(self.place, name, dtype)


def bench_dtype(axes: int) -> np.dtype:
    """What the plant's process tells the others."""
    return np.dtype(
        [
            ("tick", "i8"),
            ("wrench_in_sensor", "f8", (6,)),
            ("impedance_ohm", "f8"),
            ("impedance_pair", "i8"),
            ("impedance_sequence", "i8"),
            ("angle_rad", "f8", (axes,)),
            ("current_a", "f8", (axes,)),
        ]
    )


def main() -> int:
    """See the head of the module."""
    settings = json.load(sys.stdin)
    try:
        return run(sys.argv[1], settings)
    except RtctlError as error:
        print(f"rtctl: emulated bench, {sys.argv[1]}: {error}", file=sys.stderr)
        return error.exit_code


def run(part: str, settings: Mapping[str, Any]) -> int:
    """Be `part` of the bench until SIGTERM. Raises RtctlError."""
    rig_options = options.read(RigOptions, settings["rig"], "backend.options.rig")
    place = settings["place"]
    station = RealStation(place, settings["period_s"], settings["seed"])
    try:
        if part == PLANT:
            step = _plant(settings, rig_options, station)
        else:
            step = _device(part, settings, station)
        _pace(step, station.period_s, rig_options.realtime_priority)
    finally:
        for name in station.names:
            memory.remove(place, name)
        station.links.remove()
    return 0


def lives_apart(entry: Mapping[str, Any]) -> bool:
    """True if the device of the table `entry` gets a process of its own. Raises BackendError for an unknown kind."""
    return emulators.load(str(entry.get("kind"))).apart


def _plant(settings: Mapping[str, Any], rig_options: RigOptions, station: RealStation) -> Callable[[int], None]:
    wired = [entry for entry in settings["devices"] if not lives_apart(entry)]
    rig = Rig(wired, rig_options.plant, station)
    told = station.share("bench", bench_dtype(rig.plant.axes))

    def step(tick: int) -> None:
        station.links.fetch()
        rig.step(tick)
        station.links.deliver()
        bench, row = rig.bench, told[0]
        row["wrench_in_sensor"], row["angle_rad"], row["current_a"] = (
            bench.wrench_in_sensor,
            bench.angle_rad,
            bench.current_a,
        )
        row["impedance_ohm"], row["impedance_pair"] = bench.impedance_ohm, bench.impedance_pair
        row["impedance_sequence"], row["tick"] = bench.impedance_sequence, tick

    return step


def _device(name: str, settings: Mapping[str, Any], station: RealStation) -> Callable[[int], None]:
    entry = next((e for e in settings["devices"] if e.get("name") == name), None)
    if entry is None:
        raise BackendError("no such device on the bench", value=name)
    emulator = add_emulator(entry, station)
    told = memory.attach(settings["place"], "bench", bench_dtype(settings["axes"]))
    bench = Bench(settings["axes"])

    def step(tick: int) -> None:
        row = told[0]
        bench.wrench_in_sensor[:], bench.angle_rad[:], bench.current_a[:] = (
            row["wrench_in_sensor"],
            row["angle_rad"],
            row["current_a"],
        )
        bench.impedance_ohm, bench.impedance_pair = float(row["impedance_ohm"]), int(row["impedance_pair"])
        bench.impedance_sequence = int(row["impedance_sequence"])
        emulator.drive(tick, bench)
        emulator.sense(tick, bench)

    return step


def _pace(step: Callable[[int], None], period_s: float, priority: int) -> None:
    """Call `step` for every tick of a grid, in time where the machine allows it, until SIGTERM."""
    ended = False

    def end(*_: object) -> None:
        nonlocal ended
        ended = True

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)
    step(0)
    with contextlib.suppress(
        OSError
    ):  # without the right the bench jitters, as the loop will too, which tells the user
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    cores = os.sched_getaffinity(0)
    if len(cores) > 1:
        os.sched_setaffinity(0, cores - {max(cores)})  # the last one is the loop's
    print("ready", flush=True)
    due = time.monotonic()
    tick = 0
    while not ended:
        due += period_s
        late = time.monotonic() - due
        if late > 0.0:
            due += late  # time lost is lost: caught up, shafts would seem to turn faster than any motor can
        else:
            time.sleep(-late)
        tick += 1
        step(tick)


if __name__ == "__main__":
    sys.exit(main())
