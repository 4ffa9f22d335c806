"""How long an insertion plan takes, and what surrounds it: the checks, and reading it from a file."""

import time
from collections.abc import Callable

import numpy as np

from bench.figures import Figure, Target
from rtctl import robots
from rtctl.plan_file import describe, document, from_document, known_plan
from rtctl.planner import make_plan, plan_of
from rtctl.settings import Settings

PART = "planning"
TARGET = Target(2.0)
ROUNDS = 7


def measure(settings: Settings) -> list[Figure]:
    """Seconds of a plan of 31 depths, of its checks, and of the way through a document.

    Raises:
        PlanError: there is no plan for these settings.
    """
    robot = robots.load(settings.robot.kind, settings.robot.geometry)
    entry = np.array(settings.workflow.entry_pose_mm_rad)
    plan = plan_of(settings)
    stored = document(describe(settings, plan, entry))
    costs: tuple[tuple[str, Callable[[], object], Target | None], ...] = (
        ("plan", lambda: plan_of(settings), TARGET),
        ("place and check it", lambda: make_plan(settings, robot, entry, 1, known=plan), None),
        ("read it from a file", lambda: known_plan(settings, from_document(stored)), None),
    )
    note = f"{len(plan.depth_mm)} depths; median of {ROUNDS}"
    return [Figure(PART, name, "s", _median_s(cost), target=target, note=note) for name, cost, target in costs]


def _median_s(cost: Callable[[], object]) -> float:
    taken = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        cost()
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))
