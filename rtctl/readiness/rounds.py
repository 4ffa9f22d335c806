"""Rounds of a certificate: a run of the real loop and one of cyclictest, in turn."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from hal.errors import RtctlError
from rtctl.daemon import Daemon
from rtctl.exchange.control import Grade, Word, get
from rtctl.readiness import cyclictest
from rtctl.readiness.boxes import Boxes, Recorder
from rtctl.readiness.direct import DirectOperator, run_daemon
from rtctl.readiness.facts import Facts
from rtctl.readiness.operation import operate
from rtctl.readiness.overruns import Overruns
from rtctl.readiness.times import Times
from rtctl.readiness.usage import Usage, usage_of
from rtctl.settings import Settings

LEAST_ROUND_S = 1.0
DRAIN_S = 0.004
"""Between two looks at the ring, as the gateway does it: who held the loop shows only while it is held."""


@dataclass(frozen=True)
class Plan:
    """What is to be measured.

    Attributes:
        seconds: of the loop in all rounds together; the reference takes as long again.
        rounds: how many.
        load: kind of load, a name in :data:`rtctl.readiness.load.KINDS`.
    """

    seconds: float
    rounds: int
    load: str

    def __post_init__(self) -> None:
        """Raises RtctlError if a round would be too short to mean anything."""
        if not self.round_s >= LEAST_ROUND_S:
            raise RtctlError("a round is too short", value=f"{self.round_s:.2g} s", bound=f"at least {LEAST_ROUND_S:g} s", remedy="take more minutes or fewer rounds")  # fmt: skip

    @property
    def round_s(self) -> float:
        """Time of the loop in one round."""
        return self.seconds / self.rounds


@dataclass(frozen=True)
class Step:
    """Where the measurement is: `done_s` of `total_s` are measured, `what` comes next."""

    round: int
    what: str
    done_s: float
    total_s: float


@dataclass(frozen=True)
class LoopRound:
    """What one run of the loop gave.

    Attributes:
        lateness, tick: of all its ticks.
        boxes: who held it.
        usage: of the real-time process, at the begin and at the end.
        lost: records that were overwritten before they were seen.
    """

    lateness: Times
    tick: Times
    overruns: Overruns
    boxes: Boxes
    usage: tuple[Usage, Usage]
    grade: Grade
    lost: int


@dataclass(frozen=True)
class Round:
    """One round; `reference` is None where there is no cyclictest."""

    loop: LoopRound
    reference: Times | None


def rounds(
    settings: Settings, plan: Plan, *, moving: bool, referenced: bool, tell: Callable[[Step], None]
) -> Iterator[Round]:
    """Loop and reference, in an order that turns round each time.

    Raises:
        RtctlError: the daemon or the reference failed.
    """
    parts = ("loop", "cyclictest") if referenced else ("loop",)
    total_s, done_s = len(parts) * plan.seconds, 0.0
    for number in range(1, plan.rounds + 1):
        loop, reference = None, None
        for part in parts if number % 2 else reversed(parts):
            tell(Step(number, part, done_s, total_s))
            if part == "loop":
                loop = loop_round(settings, plan.round_s, moving, number)
            else:
                reference = cyclictest.measure(settings, plan.round_s)
            done_s += plan.round_s
        assert loop is not None
        yield Round(loop, reference)


def loop_round(settings: Settings, seconds: float, moving: bool, number: int) -> LoopRound:
    """Run the real daemon, without a gateway, for so long; every tick counts, from the first to the last.

    Raises:
        RtctlError: it failed.
        KeyboardInterrupt: it was told to end.
    """
    lateness, tick = Times(), Times()
    overruns = Overruns(round(settings.loop.period_s * 1e9), number)
    operators: list[DirectOperator] = []
    recorders: list[Recorder] = []
    told: list[tuple[Usage, Usage, Grade]] = []

    def see(rows: np.ndarray, position: int) -> None:
        recorders[0].watch(rows, position)
        if len(rows):
            lateness.add(rows["lateness_ns"])
            tick.add(rows["tick_ns"])
            overruns.see(rows)

    def run(daemon: Daemon) -> None:
        assert daemon.real_time is not None
        pid, facts = daemon.real_time.pid, Facts()
        recorders.append(Recorder(daemon, number))
        operators.append(DirectOperator(daemon, see, DRAIN_S))
        before = usage_of(pid, facts)
        operate(operators[0], settings, seconds, moving)
        told.append((before, usage_of(pid, facts), Grade(get(daemon.control, Word.GRADE))))

    run_daemon(settings, run, gateway=False)
    operators[0].glance()  # the ticks in which it came to rest
    before, after, grade = told[0]
    return LoopRound(lateness, tick, overruns, recorders[0].close(), (before, after), grade, operators[0].lost)
