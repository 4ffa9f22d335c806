"""The import contracts hold, and each of them has teeth: a planted import breaks exactly the contract meant for it."""

import shutil
import subprocess
import sys
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("hal", "drivers", "sim_backends", "rtctl")

SEAM = "hal imports nothing of ours"
DRIVERS = "drivers import only hal"
SIMULATIONS = "sim_backends import hal and pure mathematics, never the controller"
BACKENDS = "rtctl finds a backend by its name, never by import"
MATHEMATICS = "robots and electrode know nothing of the controller"
REALTIME = "the real-time process is light: no network, no log, no science library"
TIME = "nobody in the tick's reach but rtctl.clock reads time"

IN_REAL_TIME = [
    "tick",
    "loop",
    "clock",
    "lifecycle",
    "hlc",
    "judge",
    "conditions",
    "homing",
    "wrench",
    "admittance",
    "trajectory",
    "llc",
    "profile",
    "propose",
    "record",
    "memory",
    "controller",
    "parameters",
    "machine",
    "rehearsal",
    "handover",
    "settings",
    "electrode.path",
    "robots.interface",
    "commands",
    "exchange.ring",
    "exchange.mailbox",
    "exchange.segment",
    "exchange.control",
    "exchange.poll",
]


@pytest.fixture
def planted(tmp_path):
    """A function that copies the packages, appends a line to a file of the copy, and lints it."""

    def plant(file: str, line: str) -> subprocess.CompletedProcess:
        for package in PACKAGES:
            shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / ".importlinter", tmp_path)
        target = tmp_path / file
        target.write_text((target.read_text() if target.exists() else "") + f"\n{line}\n")
        return lint(tmp_path)

    return plant


def lint(directory: Path) -> subprocess.CompletedProcess:
    """Run lint-imports on the packages in `directory`."""
    command = [str(Path(sys.executable).parent / "lint-imports"), "--no-cache", "--no-logo"]
    return subprocess.run(command, cwd=directory, capture_output=True, text=True, check=False)


def verdicts(output: str) -> dict[str, str]:
    """Contract -> KEPT or BROKEN."""
    names = (SEAM, DRIVERS, SIMULATIONS, BACKENDS, MATHEMATICS, REALTIME, TIME)
    lines = output.splitlines()
    return {n: word for n in names for word in ("KEPT", "BROKEN") if any(x.startswith(f"{n} {word}") for x in lines)}


def test_all_contracts_are_kept():
    result = lint(ROOT)
    assert result.returncode == 0, result.stdout
    assert set(verdicts(result.stdout).values()) == {"KEPT"}
    assert len(verdicts(result.stdout)) == 7


@pytest.mark.parametrize(
    ("file", "line", "broken"),
    [
        ("hal/frames.py", "import rtctl.commands", {SEAM}),
        ("drivers/mine.py", "import rtctl.robots", {DRIVERS}),
        ("drivers/mine.py", "import sim_backends.plant.options", {DRIVERS}),
        ("sim_backends/plant/device.py", "from rtctl import llc", {SIMULATIONS}),
        ("sim_backends/plant/mine.py", "import rtctl.settings", {SIMULATIONS}),
        ("rtctl/controller.py", "import sim_backends.plant.backend", {BACKENDS}),
        ("rtctl/robots/robot.py", "from rtctl import record", {MATHEMATICS}),
        ("rtctl/tick.py", "import scipy.linalg", {REALTIME}),
        ("rtctl/exchange/poll.py", "import zenoh", {REALTIME}),
        ("hal/kernel.py", "import asyncio", {REALTIME}),
        ("rtctl/electrode/path.py", "import rtctl.electrode.planning", {REALTIME}),
        ("rtctl/machine.py", "from rtctl.log import format", {REALTIME}),
        ("rtctl/machine.py", "import time", {TIME}),
        ("sim_backends/plant/noise.py", "from time import monotonic", {TIME}),
    ],
)
def test_a_planted_import_breaks_its_contract(planted, file, line, broken):
    result = planted(file, line)
    assert result.returncode == 1, result.stdout + result.stderr
    found = verdicts(result.stdout)
    assert {name for name, word in found.items() if word == "BROKEN"} >= broken
    assert len(found) == 7


@pytest.fixture(scope="module")
def graph():
    return grimp.build_graph(*PACKAGES, cache_dir=None)


def test_the_entry_point_reaches_all_that_runs_in_real_time(graph):
    """The contract on rtctl.realtime covers the tick only as long as the process really imports it."""
    reached = graph.find_upstream_modules("rtctl.realtime")
    assert {f"rtctl.{name}" for name in IN_REAL_TIME} <= reached


def test_robots_and_electrode_import_nothing_else_of_rtctl(graph):
    own = ("hal", "rtctl.robots", "rtctl.electrode")
    for module in graph.modules:
        if module.startswith(own[1:]):
            strangers = [m for m in graph.find_modules_directly_imported_by(module) if not m.startswith(own)]
            assert strangers == []
