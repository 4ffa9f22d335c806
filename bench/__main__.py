"""`python -m bench`: measure, print a table, exit 0 if every target that could be measured is met."""

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path

from rich.console import Console

from bench import (
    epos_cost,
    exchange_cost,
    guidance_cost,
    hardware_cost,
    impedance_cost,
    kinematics_cost,
    lockstep_speed,
    loop_cost,
    memory_growth,
    mujoco_cable,
    planning_cost,
    rates,
    rod_study,
    spin_cost,
    stage_cost,
    storm,
    tick_cost,
    wake_up,
)
from bench.figures import Figure, table
from bench.recorded import record_insertion
from hal.errors import RtctlError
from rtctl.settings import load

SPEED = (
    "tick",
    "kinematics",
    "loop",
    "stages",
    "wake-up",
    "rates",
    "storm",
    "spin",
    "lockstep",
    "exchange",
    "guidance",
    "planning",
    "impedance",
    "hardware",
    "epos",
)
STUDIES = ("rod", "robustness", "phenomena", "mujoco")
"""Of the array by itself; they take minutes, and only when asked for."""
PARTS = SPEED + STUDIES
RECORDED = {"tick", "rates", "lockstep", "exchange", "impedance"}
"""Parts that run a recorded insertion again."""
FAILED = "failed"
SEED = 1
WIDTH = 170
"""Of the table when it goes into a file or a pipe [characters]."""


def main() -> int:
    """Run the parts asked for; 0 if all is well, 1 if a target is missed or a part failed, else the error's code."""
    arguments = _arguments()
    console = Console(stderr=True)
    try:
        figures = []
        for name, part in _parts(arguments):
            with console.status(f"{name} ..."):
                figures += _attempted(name, part)
    except RtctlError as error:
        print(f"bench: {error}", file=sys.stderr)
        return error.exit_code
    Console(width=None if sys.stdout.isatty() else WIDTH).print(table(figures))
    if arguments.json is not None:
        document = {"machine": _machine(), "figures": [figure.as_table() for figure in figures]}
        arguments.json.write_text(json.dumps(document, indent=1) + "\n")
    return int(any(figure.met is False or figure.name == FAILED for figure in figures))


def _attempted(name: str, part: Callable[[], list[Figure]]) -> list[Figure]:
    """Figures of a part; if it fails, why, so that the other parts are not lost."""
    try:
        return part()
    except RtctlError as error:
        return [Figure(name, FAILED, "", None, note=str(error))]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench",
        description=__doc__,
        epilog="example: python -m bench wake-up --rounds 30 --json wake.json",
    )
    parser.add_argument(
        "parts", nargs="*", default=SPEED, help=f"of {', '.join(PARTS)}; {', '.join(SPEED)} when absent"
    )
    parser.add_argument("--config", default="planar-sim", help="settings to measure with [planar-sim]")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change a setting")
    parser.add_argument(
        "--rounds",
        type=int,
        default=15,
        help="of whatever is measured in turns: loop and cyclictest, storm and calm; a third for each of the rates [15]",
    )
    parser.add_argument("--seconds", type=float, default=4.0, help="of each of them in a round [4]")
    parser.add_argument("--memory", action="store_true", help="measure only whether the daemon grows over a long run")
    parser.add_argument("--minutes", type=float, default=10.0, help="of that run [10]")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to a file, too")
    arguments = parser.parse_args()
    unknown = set(arguments.parts) - set(PARTS)
    if unknown:
        parser.error(f"no such part: {', '.join(sorted(unknown))} (choose from {', '.join(PARTS)})")
    return arguments


def _parts(arguments: argparse.Namespace) -> Iterator[tuple[str, Callable[[], list[Figure]]]]:
    """Name and measurement of everything asked for, in order."""
    # a name of its own, so that the bench can run beside a daemon
    settings = load(arguments.config, [f"robot.name=bench{os.getpid()}", *arguments.set])
    if arguments.memory:
        yield "memory", lambda: memory_growth.measure(settings, arguments.minutes)
        return
    asked = arguments.parts
    pieces = record_insertion(settings, SEED) if RECORDED & set(asked) else []
    measurements: dict[str, Callable[[], list[Figure]]] = {
        "tick": lambda: tick_cost.measure(settings, pieces),
        "kinematics": kinematics_cost.measure,
        "loop": lambda: loop_cost.measure(settings),
        "stages": lambda: stage_cost.measure(settings, arguments.seconds),
        "wake-up": lambda: wake_up.measure(settings, arguments.rounds, arguments.seconds),
        "rates": lambda: rates.measure(settings, pieces, max(arguments.rounds // 3, 1), arguments.seconds),
        "storm": lambda: storm.measure(settings, arguments.rounds, arguments.seconds),
        "spin": lambda: spin_cost.measure(settings, arguments.rounds, arguments.seconds),
        "lockstep": lambda: lockstep_speed.measure(settings, SEED, pieces),
        "exchange": lambda: exchange_cost.measure(settings, pieces),
        "planning": lambda: planning_cost.measure(settings),
        "guidance": lambda: guidance_cost.measure(settings, SEED),
        "impedance": lambda: impedance_cost.measure(settings, pieces),
        "hardware": hardware_cost.measure,
        "epos": epos_cost.measure,
        "rod": rod_study.measure_mesh,
        "robustness": rod_study.measure_robustness,
        "phenomena": rod_study.measure_phenomena,
        "mujoco": mujoco_cable.measure,
    }
    yield from ((name, measurements[name]) for name in PARTS if name in asked)


def _machine() -> dict[str, str | int]:
    """Where the figures come from."""
    cpu = next((line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")), "")
    packages = {name: metadata.version(name) for name in ("numpy", "numba", "llvmlite")}
    return {
        "cpu": cpu.partition(":")[2].strip(),
        "cores": os.cpu_count() or 0,
        "kernel": platform.release(),
        "python": platform.python_version(),
        **packages,
    }


if __name__ == "__main__":
    sys.exit(main())
