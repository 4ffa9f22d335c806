"""Makes a certificate: rounds of the real loop and of cyclictest in turn, under a declared load."""

from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from hal.backend import load as load_backend
from hal.kernel import kernel_hash
from rtctl.exchange.control import Grade
from rtctl.gateway.setup import packages, revision
from rtctl.readiness import certificate, cyclictest
from rtctl.readiness.boxes import Boxes
from rtctl.readiness.doctor import examine
from rtctl.readiness.load import Load
from rtctl.readiness.measured import Distribution, process_table, ratios
from rtctl.readiness.operation import MOVING, STILL
from rtctl.readiness.overruns import Overruns
from rtctl.readiness.rounds import Plan, Round, Step, rounds
from rtctl.readiness.verdicts import judge
from rtctl.settings import Settings, config_hash, public_table
from rtctl.warmup import warm_up_apart


def certify(settings: Settings, plan: Plan, tell: Callable[[Step], None] = lambda _: None) -> dict[str, Any]:
    """Measure; the sealed document, which Ctrl-C after a complete round leaves incomplete.

    Raises:
        KeyboardInterrupt: before one round was complete.
        RtctlError: the daemon, the load or the reference failed: there is no certificate of half the truth.
    """
    warm_up_apart(settings)  # before there is any load
    begun = datetime.now(UTC)
    choice = settings.backend
    backend = load_backend(choice.name, choice.options, period_s=settings.loop.period_s, seed=0)
    diagnosis = examine(settings)
    obstacle = cyclictest.obstacle(settings)
    folder = certificate.folder_of(settings)
    folder.mkdir(parents=True, exist_ok=True)
    sums, declared = _Sums(settings), {}
    try:
        with Load(plan.load, folder, diagnosis.core) as load:
            for one in rounds(settings, plan, moving=backend.simulated, referenced=not obstacle, tell=tell):
                load.check()
                sums.add(one)
                declared = load.declared()
    except KeyboardInterrupt:
        if not sums.grades:
            raise
    content = {
        "format": certificate.FORMAT,
        "complete": len(sums.grades) == plan.rounds,
        "begun": begun.isoformat(timespec="seconds"),
        "ended": datetime.now(UTC).isoformat(timespec="seconds"),
        "robot": settings.robot.name,
        "backend": choice.name,
        "operation": MOVING if backend.simulated else STILL,
        "rounds": len(sums.grades),
        "rounds_asked": plan.rounds,
        "round_s": plan.round_s,
        "load": declared,
        "machine": certificate.machine(),
        "config_hash": config_hash(settings),
        "kernel_hash": kernel_hash(),
        "revision": revision(),
        "packages": packages(),
        "loop": {
            "period_us": settings.loop.period_s * 1e6,
            "priority": settings.loop.priority,
            "core": diagnosis.core,
            "grade": min(sums.grades).name.lower().replace("_", "-"),
        },
        **sums.as_tables(obstacle),
        "findings": [asdict(f) for f in diagnosis.findings],
        "settings": public_table(settings),
    }
    return certificate.sealed(content | judge(content))


class _Sums:
    """Complete rounds; one that was not finished leaves nothing."""

    def __init__(self, settings: Settings) -> None:
        self._period_ns = round(settings.loop.period_s * 1e9)
        self._lateness, self._tick, self._reference = Distribution(), Distribution(), Distribution()
        self._overruns, self._boxes = Overruns(self._period_ns), Boxes()
        self._usages: list[tuple[Any, Any]] = []
        self._lost = 0
        self.grades: list[Grade] = []

    def add(self, one: Round) -> None:
        """One more."""
        self._lateness.add_round(one.loop.lateness)
        self._tick.add_round(one.loop.tick)
        if one.reference is not None:
            self._reference.add_round(one.reference)
        self._overruns.merge(one.loop.overruns)
        self._boxes.merge(one.loop.boxes)
        self._usages.append(one.loop.usage)
        self._lost += one.loop.lost
        self.grades.append(one.loop.grade)

    def as_tables(self, obstacle: str) -> dict[str, Any]:
        """What was measured, plain data; of the reference why there is none, where there is none."""
        reference: dict[str, Any] = {"name": "cyclictest", "obstacle": obstacle}
        if not obstacle:
            late = self._reference.all.longer_than(self._period_ns)
            reference |= {"lateness": self._reference.as_table(), "later_than_a_period": late}
        return {
            "lateness": self._lateness.as_table(),
            "tick": self._tick.as_table(),
            "reference": reference,
            "ratios": None if obstacle else ratios(self._lateness, self._reference),
            "overruns": self._overruns.as_table(),
            "black_boxes": self._boxes.as_table(),
            "lost_records": self._lost,
            "process": process_table(self._usages),
        }
