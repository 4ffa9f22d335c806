"""(g) What the failure detectors cost the tick: in the middle, and in the ticks in which they have something to do."""

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.figures import Figure, Target, compare, in_turns
from bench.recorded import Piece, record_insertion
from hal.kernel import kernel
from rtctl.clock import grid, now_ns
from rtctl.commands import Verb
from rtctl.exchange.mailbox import forget
from rtctl.guidance import detector_file, training
from rtctl.guidance.dataset import synthesise
from rtctl.settings import Settings, from_table, public_table
from rtctl.tick import tick

PART = "guidance"
ROUNDS = 31
MEDIAN_TARGET, WORST_TARGET, DECISION_TARGET_US = Target(2.0), Target(5.0), Target(50.0)
PERCENTILES = (50, 90, 99, 99.9, 100)


def measure(settings: Settings, seed: int) -> list[Figure]:
    """The same insertion with and without a detector, tick by tick, in turns.

    Of every tick the fastest of all rounds counts: what the machine does to a tick hits another one each time, what the
    tick itself does comes again. Raises RtctlError if the insertion does not come to its end.
    """
    piece = next(p for p in record_insertion(with_detector(settings), seed) if p.verb == Verb.INSERT)
    on, off = in_turns(ROUNDS, lambda: tick_times_us(piece, 1), lambda: tick_times_us(piece, 0))
    medians = [[float(np.median(times)) for times in rounds] for rounds in (on, off)]
    fastest_on, fastest_off = (
        np.min(on, axis=0)[1:],
        np.min(off, axis=0)[1:],
    )  # the first has the command, in cold memory
    busy = np.diff(piece.records["detector_samples"]) > 0
    decided = float(np.median(fastest_on[busy]))
    ratio = float(fastest_on.max() / np.median(fastest_on))
    return [
        compare(PART, "one tick, detectors on", "us", *medians, reference_name="off", target=MEDIAN_TARGET, note=histogram(fastest_on)),
        Figure(PART, "slowest tick over the median, on", "", ratio, target=WORST_TARGET, note=f"{len(fastest_on)} ticks, the fastest of {ROUNDS} rounds each"),
        Figure(PART, "slowest tick over the median, off", "", float(fastest_off.max() / np.median(fastest_off)), note=histogram(fastest_off)),
        Figure(PART, "tick with sample, prediction, decision", "us", decided, float(np.median(fastest_on[~busy])), "no sample", target=DECISION_TARGET_US, note=f"{int(busy.sum())} of them"),
    ]  # fmt: skip


def with_detector(settings: Settings) -> Settings:
    """The settings with a detector trained on SYN-1 that only warns."""
    detector = training.train(synthesise(0, 51, 56), reference_forces=True)
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "detector.json"
        detector_file.write(detector, path)
        table = public_table(settings)
        table["guidance"] = {"detector": str(path)}
        return from_table(json.loads(json.dumps(table)))


def tick_times_us(piece: Piece, on: int) -> np.ndarray:
    """Time of every tick of a piece (n,) [us], the detector switched `on` or off."""
    memory, records, actuators = piece.memory.copy(), piece.inputs(), np.zeros_like(piece.actuators)
    memory["detector"]["on"] = on
    times: np.ndarray = np.zeros(len(records), "i8")
    timed_drive(memory, piece.sensors, actuators, records, grid(1.0), times)
    return times * 1e-3


def histogram(times_us: Sequence[float] | np.ndarray) -> str:
    """Percentiles in words."""
    values = np.percentile(times_us, PERCENTILES)
    return "us: " + ", ".join(
        f"{'max' if p == 100 else f'p{p:g}'} {v:.2f}" for p, v in zip(PERCENTILES, values, strict=True)
    )


@kernel
def timed_drive(memory, sensors, actuators, records, clock, times):
    """As :func:`bench.recorded.drive`, with the time of each tick [ns]."""
    for k in range(records.shape[0]):
        begin = now_ns(clock[0])
        tick(memory[0], sensors[k], actuators[k], records[k])
        times[k] = now_ns(clock[0]) - begin
        forget(memory[0].command)
