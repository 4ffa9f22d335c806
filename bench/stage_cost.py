"""(k) What each stage of a tick costs in the real loop, against its budget, and what it costs to know that."""

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from bench.figures import Figure, Target, in_turns
from bench.real_time import BenchOperator, records_of
from hal.backend import CompiledDevice, load
from hal.kernel import Pointer, direct, specialised
from rtctl import clock as clocks
from rtctl import usage as usages
from rtctl.attribution.budget import bounds_ns, over_budget
from rtctl.commands import Verb
from rtctl.controller import Controller
from rtctl.exchange.ring import commit
from rtctl.exchange.segment import Segment
from rtctl.handover import layout
from rtctl.settings import Settings
from rtctl.stages import POLL, READ, RECORD, STAGES, TICK
from rtctl.tick import tick as run_tick

PART = "stages"
LOW, HIGH = 50.0, 99.0
MOVE_MM, MOVE_S = 2.0, 10.0
TICKS, ROUNDS = 4000, 15
A_THOUSANDTH = 1e-3
"""Of the period: what stamps and the look at page faults may cost."""


def measure(settings: Settings, seconds: float) -> list[Figure]:
    """Percentiles of every stage of a run of `seconds` with motions, and a tick with and without stamps, in turns.

    Raises:
        RtctlError: the run failed.
    """
    rows = records_of(settings, partial(_script, seconds))
    return [*_stages(rows, settings.loop.period_s), *_stamps(settings)]


def _script(seconds: float, operator: BenchOperator) -> None:
    """Enable, home, and move to and fro: every motion is one that has to be prepared."""
    end_s = time.monotonic() + seconds
    operator.command(Verb.ENABLE)
    operator.wait(lambda record: record["powered"], seconds)
    operator.command(Verb.HOME)
    operator.wait(lambda record: record["is_homed"] and not record["is_busy"], seconds + MOVE_S)
    pose, sign = np.array(operator.robot.home_pose), 1.0
    while time.monotonic() < end_s:
        pose[0] += sign * MOVE_MM
        operator.command(Verb.MOVE_CP, *pose)
        operator.wait(lambda record: not record["is_busy"], MOVE_S)
        sign = -sign


def _stages(rows: np.ndarray, period_s: float) -> list[Figure]:
    """Each stage, then the whole tick."""
    figures = []
    for number, stage in enumerate(STAGES):
        cost_us = rows["stage_ns"][:, number] * 1e-3
        cost_us = cost_us[cost_us > 0]
        name = f"{stage.name} p{HIGH:g}"
        if len(cost_us):
            figures.append(_figure(name, cost_us, stage.budget_us, period_s, stage.reason))
        else:
            figures.append(Figure(PART, name, "us", None, note="it did not occur in this run"))
    longest_ns, latest_ns = bounds_ns(round(1e9 * period_s))
    whole_us = (rows["tick_ns"][:-1] + rows["stage_ns"][1:, RECORD]) * 1e-3
    bound = f"a tick may take {longest_ns * 1e-3:g} us, a wake-up be late by {latest_ns * 1e-3:g} us"
    figures.append(_figure(f"whole tick p{HIGH:g}", whole_us, longest_ns * 1e-3, period_s, bound))
    over = int(over_budget(rows, round(1e9 * period_s)).sum())
    figures.append(Figure(PART, "ticks over budget", "", float(over), note=f"of {len(rows)}, {int(rows['missed_ticks'][1:].sum())} grid points missed"))  # fmt: skip
    return figures


def _figure(name: str, cost_us: np.ndarray, budget_us: float, period_s: float, reason: str) -> Figure:
    """Cost against the budget; in the note median, share of the period, slack, and the budget's reason."""
    low, high = (float(p) for p in np.percentile(cost_us, (LOW, HIGH)))
    note = f"p50 {low:.3g} us, {high * 1e-4 / period_s:.2g} % of the period, slack {budget_us - high:.4g} us; {reason}"
    return Figure(PART, name, "us", high, target=Target(budget_us), note=note)


def _stamps(settings: Settings) -> list[Figure]:
    """Median time of a tick with plant and record, with all stamps and without, in one process."""
    choice = settings.backend
    backend = load(choice.name, choice.options, period_s=settings.loop.period_s, seed=1)
    device, truth = backend.compiled(), backend.truth()
    if device is None or truth is None:
        return [
            Figure(PART, "five stamps, faults and switches", "us", None, note="skipped: the backend has no kernels")
        ]
    controller = Controller(settings)
    segment = Segment.create(layout(controller, backend))
    backend.open()
    with_stamps, without = (_timed(way, controller, segment, device) for way in (_stamped, _bare))
    with_stamps(), without()  # whatever has to be loaded
    ours, theirs = in_turns(ROUNDS, with_stamps, without)
    segment.close()
    extra_us = float(np.median(np.asarray(ours) - np.asarray(theirs)))
    note = (
        f"a tick, plant and commit included, takes {np.median(theirs):.3g} us without; {ROUNDS} rounds of {TICKS} ticks"
    )
    bound = Target(A_THOUSANDTH * 1e6 * settings.loop.period_s)
    return [Figure(PART, "five stamps, faults and switches", "us", extra_us, target=bound, note=note)]


def _timed(
    way: Callable[..., None], controller: Controller, segment: Segment, device: CompiledDevice
) -> Callable[[], float]:
    """A function that runs TICKS ticks and returns the time of one [us]."""
    memory = controller.memory, controller.sensors, controller.actuators, controller.record
    hal = device.device, Pointer(device.read), Pointer(device.write)
    arguments = clocks.grid(1.0), np.zeros(1, usages.USAGE), TICKS, *memory, segment.records, *hal
    code = direct(specialised(way, arguments))

    def run() -> float:
        start = time.perf_counter()
        code(*arguments)
        return (time.perf_counter() - start) / TICKS * 1e6

    return run


def _bare(clock, _usage, ticks, memory, sensors, actuators, record, records, device, read, write):
    for tick in range(ticks):
        read(device[0], tick, sensors[0])
        run_tick(memory[0], sensors[0], actuators[0], record[0])
        write(device[0], tick, actuators[0])
        clocks.stamp_duration(clock[0], record[0])
        commit(records, record[0])


def _stamped(clock, usage, ticks, memory, sensors, actuators, record, records, device, read, write):
    for tick in range(ticks):
        clocks.stamp(clock[0], record[0], POLL)
        read(device[0], tick, sensors[0])
        clocks.stamp(clock[0], record[0], READ)
        run_tick(memory[0], sensors[0], actuators[0], record[0])
        clocks.stamp(clock[0], record[0], TICK)
        write(device[0], tick, actuators[0])
        clocks.stamp_duration(clock[0], record[0])
        usages.note(usage[0], record[0])
        commit(records, record[0])
        clocks.stamp(clock[0], record[0], RECORD)
