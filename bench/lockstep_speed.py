"""(d) How much faster than real time the lockstep runs, and where its time goes."""

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from bench.figures import Figure, Target
from bench.real_time import BenchError
from bench.recorded import Piece, differing_fields, drive
from bench.tick_cost import tick_us
from hal.kernel import specialised
from rtctl.commands import Verb
from rtctl.lockstep import Lockstep
from rtctl.settings import Settings
from rtctl.simulation import Recorder, simulate

PART = "lockstep"
TARGET = Target(100.0, at_least=True)
ROUNDS = 7


def measure(settings: Settings, seed: int, pieces: Sequence[Piece]) -> list[Figure]:
    """Factor of a whole simulated insertion, and the cost of the parts of a tick without and with an array.

    Raises:
        RtctlError: the insertion did not come to its end.
    """
    factors = [_factor(settings, seed) for _ in range(ROUNDS)]
    note = f"whole insertion, planning apart; {ROUNDS} rounds {min(factors):.0f}..{max(factors):.0f}"
    figures = [Figure(PART, "faster than real time", "x", float(np.median(factors)), target=TARGET, note=note)]
    lockstep = Lockstep(settings, seed)
    for name, verb in (("no array", Verb.MOVE_CP), ("array in cochlea", Verb.INSERT)):
        piece = next(p for p in pieces if p.verb == verb)
        costs: dict[str, Callable[[], float]] = {
            "tick, plant and record": partial(_whole_us, lockstep, piece),
            "tick": partial(tick_us, piece, drive),
            "plant": partial(_plant_us, lockstep, piece),
            "watch the record": partial(_keep_us, lockstep, piece),
        }
        for part, cost in costs.items():
            median = float(np.median([cost() for _ in range(ROUNDS)]))
            figures.append(Figure(PART, f"{name}: {part}", "us", median, note=f"{len(piece.records)} ticks"))
    lockstep.close()
    return figures


def _factor(settings: Settings, seed: int) -> float:
    simulation = simulate(settings, seed)
    if simulation.failure is not None:
        raise simulation.failure
    return len(simulation.recording.records) * settings.loop.period_s / simulation.wall_s


def _whole_us(lockstep: Lockstep, piece: Piece) -> float:
    """Tick, plant, and what is kept of them [us]; mean over the piece, as the other costs."""
    blocks: list[np.ndarray] = []
    lockstep.sink = lambda records, _truths: blocks.append(records)
    lockstep.controller.memory[:], lockstep.device.device[:] = piece.memory, piece.device
    lockstep.tick = int(piece.records["tick"][0])
    start = time.perf_counter()
    lockstep.advance(len(piece.records))
    elapsed_s = time.perf_counter() - start
    if differing_fields(np.concatenate(blocks), piece.records):
        raise BenchError("a lockstep run again from the middle went another way", value=piece.verb.name)
    return elapsed_s / len(piece.records) * 1e6


def _plant_us(lockstep: Lockstep, piece: Piece) -> float:
    """The plant alone, under the commands it got [us]."""
    d, sensors = lockstep.device, np.zeros_like(piece.sensors[:1])
    arguments = piece.device.copy(), int(piece.records["tick"][0]), sensors, piece.actuators, d.read, d.write
    run = specialised(_run_plant, arguments)
    start = time.perf_counter()
    run(*arguments)
    return (time.perf_counter() - start) / len(piece.records) * 1e6


def _keep_us(lockstep: Lockstep, piece: Piece) -> float:
    """What `rtctl sim` does with the records: a look for events [us]."""
    recorder, truths = Recorder(), np.zeros(len(piece.records), lockstep.truth.dtype)
    start = time.perf_counter()
    recorder.take(piece.records, truths)
    return (time.perf_counter() - start) / len(piece.records) * 1e6


def _run_plant(device, first_tick, sensors, actuators, read, write):
    for k in range(actuators.shape[0]):
        read(device[0], first_tick + k, sensors[0])
        write(device[0], first_tick + k, actuators[k])
