"""What the gateway needs before it can serve: the tables of its log, the log's header, and warm kernels."""

import contextlib
import json
import platform
import subprocess
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np

from hal.backend import Backend
from hal.kernel import ROOT, kernel_hash
from hal.signals import Table
from rtctl.commands import COMMAND
from rtctl.controller import Controller
from rtctl.exchange.control import Grade, Word, get, put
from rtctl.exchange.mailbox import fetch, post, stage
from rtctl.exchange.ring import RingReader, committed
from rtctl.exchange.segment import Layout, Segment
from rtctl.log.format import CONTROLLER, TRUTH
from rtctl.planner import PlanError, make_plan
from rtctl.readiness.certificate import newest_hash
from rtctl.robots import Robot
from rtctl.settings import Settings, config_hash, public_table

PACKAGES = ("rtctl", "numpy", "scipy", "numba", "llvmlite", "ruckig", "eclipse-zenoh", "mcap", "msgspec")


def tables_of(controller: Controller, backend: Backend) -> dict[str, Table]:
    """Topic -> table of the rows a run logs."""
    truth = backend.truth()
    return {CONTROLLER: controller.table} | ({} if truth is None else {TRUTH: truth[0]})


def exercise(settings: Settings, robot: Robot, layout: Layout) -> None:
    """Compile or load every kernel the gateway calls, so that no first call holds up the heartbeat later."""
    spare = Segment.create(replace(layout, capacity=1))
    command, plan, parameters = (np.zeros(1, d) for d in (COMMAND, layout.plan, layout.parameters))
    put(spare.control, Word.GATEWAY_HEARTBEAT, get(spare.control, Word.GATEWAY_HEARTBEAT) + 1)
    post(spare.mailbox, command[0])
    for slots, payload in ((spare.plans, plan), (spare.parameters, parameters)):
        fetch(slots, stage(slots, 1, payload[0]), 1, payload[0])
    committed(spare.records)
    RingReader(spare.records, layout.record, limit=1).read()
    spare.close()
    with contextlib.suppress(PlanError):  # the plan itself is of no interest
        make_plan(settings, robot, settings.workflow.entry_pose_mm_rad, 1)


def header_of(settings: Settings, seed: int, grade: int, first_tick: int) -> dict[str, str]:
    """What is needed to run the experiment again, as texts."""
    return {
        "settings": json.dumps(public_table(settings)),
        "config_hash": config_hash(settings),
        "seed": str(seed),
        "kernel_hash": kernel_hash(),
        "robot": settings.robot.name,
        "backend": settings.backend.name,
        "grade": Grade(grade).name.lower().replace("_", "-"),
        "first_tick": str(first_tick),
        "revision": revision(),
        "python": platform.python_version(),
        "machine": platform.platform(),
        "certificate": "" if grade == Grade.SIM else newest_hash(settings),
        **{f"package.{name}": version for name, version in packages().items()},
    }


def packages() -> dict[str, str]:
    """Versions of what the results depend on, by name; what is not installed is left out."""
    return {name: version for name in PACKAGES if (version := _version(name))}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def revision() -> str:
    """Revision of the working copy we run from, with a + after it if it has changes; empty for an installation."""
    if not Path(ROOT, ".git").exists():
        return ""
    command = ["git", "-C", str(ROOT), "describe", "--always", "--abbrev=12", "--dirty=+"]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=5, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""
