"""(a) The whole tick, plant excluded, against the same arithmetic in C++ compiled in this run."""

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from bench.figures import Figure, Target, compare, in_turns
from bench.native import NativeTick, compiler, version
from bench.real_time import BenchError
from bench.recorded import Piece, differing_fields, drive
from rtctl.commands import Verb
from rtctl.controller import Controller
from rtctl.settings import Settings

PART = "tick"
TICKS = 5000
ROUNDS = 51
TARGET = Target(1.3)

Drive = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]


def measure(settings: Settings, pieces: Sequence[Piece]) -> list[Figure]:
    """Ratio of the times, in turns, on the ticks of an insertion.

    Raises:
        BenchError: the two do not compute the same on all pieces, so a ratio would mean nothing.
    """
    name = "one tick while inserting"
    if compiler() is None:
        return [Figure(PART, name, "us", None, target=TARGET, note="skipped: no g++ on this machine")]
    with tempfile.TemporaryDirectory() as directory:
        native = NativeTick(Controller(settings), Path(directory))
        for piece in pieces:
            check_equal(piece, native.drive)
        insertion = next(p for p in pieces if p.verb == Verb.INSERT).first(TICKS)
        ours, theirs = in_turns(ROUNDS, lambda: tick_us(insertion, drive), lambda: tick_us(insertion, native.drive))
    ticks = sum(len(p.records) for p in pieces)
    note = f"{ROUNDS} rounds of {len(insertion.records)}; {ticks} ticks equal to the bit"
    return [compare(PART, name, "us", ours, theirs, reference_name=f"g++ {version()} -O2", target=TARGET, note=note)]


def run_again(piece: Piece, drive: Drive) -> tuple[np.ndarray, np.ndarray]:
    """Records and actuator frames (n,) that `drive` makes of a piece."""
    memory, records, actuators = piece.memory.copy(), piece.inputs(), np.zeros_like(piece.actuators)
    drive(memory, piece.sensors, actuators, records)
    return records, actuators


def check_equal(piece: Piece, other: Drive) -> None:
    """Both must make of the piece what was recorded, to the bit. Raises BenchError."""
    for who, run in (("the compiled Python", drive), ("C++", other)):
        records, actuators = run_again(piece, run)
        fields = differing_fields(piece.records, records) + differing_fields(piece.actuators, actuators)
        if fields:
            what = f"{who} computes something else after {piece.verb.name.lower()}"
            remedy = "bring bench/cpp up to date with the kernels"
            raise BenchError(what, value=fields, bound="what was recorded", remedy=remedy)


def tick_us(piece: Piece, drive: Drive) -> float:
    """Time of one tick [us], mean over the piece."""
    memory, records, actuators = piece.memory.copy(), piece.inputs(), np.zeros_like(piece.actuators)
    start = time.perf_counter()
    drive(memory, piece.sensors, actuators, records)
    return (time.perf_counter() - start) / len(records) * 1e6
