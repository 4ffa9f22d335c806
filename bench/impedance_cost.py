"""(g) Impedance: one boundary-element solution of 270 elements, and what guidance costs in a tick."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bench.figures import Figure, Target, compare, in_turns
from bench.recorded import Piece, drive
from bench.tick_cost import tick_us
from hal.kernel import kernel
from rtctl.commands import Verb
from rtctl.controller import Controller
from rtctl.guidance.impedance import jacobian, layout
from rtctl.guidance.impedance.boundary_elements import Boundary
from rtctl.guidance.impedance.pair_model import CURRENT_A, SOURCE, fluid, impedance_ohm
from rtctl.settings import Settings, from_table, public_table

PART = "impedance"
ROUNDS = 31
TICKS = 5000
GEOMETRY = (0.3, 0.5)
SOLUTIONS, EVALUATIONS = 5, 2000
SOLUTION_MS = Target(5.0)
ALL_ON, SLOWEST = Target(2.0), Target(4.0)
"""Of the issue: a tick with guidance costs at most twice one without; with an evaluation in it at most five times."""


def measure(settings: Settings, pieces: Sequence[Piece]) -> list[Figure]:
    """Solution against the same in numpy; the law's tick against the tick; an evaluation against the tick."""
    ours, theirs = in_turns(ROUNDS, _solve_ms, _solve_in_numpy_ms)
    insertion = next(p for p in pieces if p.verb == Verb.INSERT).first(TICKS)
    guided = guided_piece(settings, insertion)
    with_law, without = in_turns(ROUNDS, lambda: tick_us(guided, drive), lambda: tick_us(insertion, drive))
    evaluation, tick = in_turns(ROUNDS, lambda: _evaluation_us(guided), lambda: tick_us(insertion, drive))
    steps = len(np.unique(insertion.records["depth_mm"] // settings.impedance.interval_mm))
    name = "a pair of 270 elements"
    return [
        Figure(PART, name, "ms", float(np.min(ours)), target=SOLUTION_MS, note=f"fastest of {ROUNDS} rounds of {SOLUTIONS}"),
        compare(
            PART, f"{name}, ratio", "ms", ours, theirs,
            reference_name="the same in numpy", target=Target(1.0), note="(VII.15) as printed, vectorised",
        ),
        compare(
            PART, "a tick with the law", "us", with_law, without,
            reference_name="without", target=ALL_ON, note=f"{TICKS} ticks, {steps} evaluations",
        ),
        compare(
            PART, "an evaluation, which a tick has now and then", "us", evaluation, tick,
            reference_name="a tick", target=SLOWEST, note="Jacobian of 22 contacts and the step",
        ),
    ]  # fmt: skip


def guided_piece(settings: Settings, piece: Piece) -> Piece:
    """The piece with the law switched on, all else the same."""
    table = public_table(settings)
    pairs = layout.CONTACTS - settings.impedance.pair_step
    table["impedance"] |= {"guidance": True, "bias_ohm": [0.0] * pairs}
    table["admittance"]["stylet"] = False
    memory = piece.memory.copy()
    memory["parameters"]["impedance_law"] = Controller(from_table(table)).memory["parameters"]["impedance_law"]
    return replace(piece, memory=memory)


def _evaluation_us(piece: Piece) -> float:
    memory, z = piece.memory, np.linspace(1500.0, 2500.0, layout.PAIRS)
    start = time.perf_counter()
    _evaluate(memory, z, z + 30.0, EVALUATIONS)
    return (time.perf_counter() - start) / EVALUATIONS * 1e6


@kernel
def _evaluate(memory, z_ohm, baseline_ohm, times):
    """The Jacobian and the step, again and again, with a stylet that moves; the sum of the steps."""
    law, gain, total = memory[0].parameters.impedance_law, memory[0].pairs.gain, 0.0
    for n in range(times):
        jacobian.approach_rates(law.modal_matrix, 5.0 + 1e-3 * n, law.place_mm, gain)
        step, _ = jacobian.stylet_step(law, gain, z_ohm, baseline_ohm, (1 << law.pairs) - 1, 1.0)
        total += step
    return total


def _solve_ms() -> float:
    start = time.perf_counter()
    for _ in range(SOLUTIONS):
        impedance_ohm(*GEOMETRY)
    return (time.perf_counter() - start) / SOLUTIONS * 1e3


def _solve_in_numpy_ms() -> float:
    start = time.perf_counter()
    for _ in range(SOLUTIONS):
        solve_in_numpy(fluid(*GEOMETRY))
    return (time.perf_counter() - start) / SOLUTIONS * 1e3


def solve_in_numpy(boundary: Boundary) -> float:
    """Impedance [ohm] by the printed formulas over whole arrays: what one writes without kernels."""
    start = boundary.node_mm
    end = np.roll(start, -1, axis=0)
    middle = 0.5 * (start + end)
    length = np.linalg.norm(end - start, axis=1)
    nx, ny = (end - start)[:, 1] / length, -(end - start)[:, 0] / length
    rx, ry = start[:, 0] - middle[:, :1], start[:, 1] - middle[:, 1:]
    a, b, e = length**2, 2.0 * length * (nx * ry - ny * rx), rx * rx + ry * ry
    t = 4.0 * a * e - b * b
    apart = t > 1e-12 * a * e
    q = np.sqrt(np.where(apart, t, 1.0))
    w = np.where(apart, np.arctan((2.0 * a + b) / q) - np.arctan(b / q), 0.0)
    f2 = length * (nx * rx + ny * ry) / (np.pi * q) * w
    logs = -b / (2.0 * a) * np.log(e / a) + (1.0 + b / (2.0 * a)) * np.log(1.0 + b / a + e / a)
    f1 = length / (4.0 * np.pi) * (2.0 * (np.log(length) - 1.0) + logs + q * w / a)
    f2 -= 0.5 * np.eye(len(length))
    matrix = np.where(boundary.has_potential, -f1, f2)
    right = f1 @ np.where(boundary.has_potential, 0.0, boundary.given)
    right -= f2 @ np.where(boundary.has_potential, boundary.given, 0.0)
    potential = np.linalg.solve(matrix, right)
    return float(potential[boundary.curve == SOURCE].mean() / CURRENT_A)
