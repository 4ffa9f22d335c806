"""The scripted insertion in lockstep with a simulated backend: what `rtctl sim` runs, and studies and benches too."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hal.backend import drawn_values, failure_of
from hal.errors import RtctlError
from hal.signals import Table
from rtctl.commands import CommandRefused, Reason, Verb, explain
from rtctl.electrode.planning import Plan
from rtctl.exchange.control import Grade
from rtctl.gateway.events import Watcher, say
from rtctl.gateway.journal import with_bytes
from rtctl.gateway.setup import header_of, tables_of
from rtctl.lifecycle import TABLE
from rtctl.lockstep import Lockstep
from rtctl.log.format import CONTROLLER, EVENTS, PARAMETERS, PLANS, TRUTH
from rtctl.log.writer import LogWriter
from rtctl.planner import make_plan
from rtctl.recording import Recording
from rtctl.settings import Settings, public_table
from rtctl.workflow import Cause, Predicate, Progress, conditions_of, insert_array

GLANCE_TICKS = 100
"""How often the script looks at the records; part of the experiment, so it must not depend on the machine."""
FAILED_STEP_SUFFIX = ".failed-step"
"""Beside the log: the state of a simulated backend that could not go on."""
LAST_TICKS = 300
"""Ticks to come to rest at the end, and as many without power after it."""


@dataclass(frozen=True)
class Simulation:
    """A simulated run: its recording, why it ended early if it did, and the wall time the loop took, log included."""

    recording: Recording
    failure: RtctlError | None
    wall_s: float


def simulate(
    settings: Settings,
    seed: int,
    *,
    log: Path | None = None,
    report: Callable[[Progress], None] = lambda _: None,
    plan: Plan | None = None,
) -> Simulation:
    """Run the work-flow in lockstep; the same settings and seed give the same records and the same log bytes.

    Args:
        log: where to write the run, a file that must not exist. A backend that could not solve a step leaves its state
            beside it.
        report: is told where the script is.
        plan: for these settings, if it is known: of :func:`rtctl.planner.plan_of`, or of a file.

    Raises:
        LogError: the log cannot be written.
        RtctlError: the backend cannot run in lockstep.
    """
    recorder = Recorder(settings.backend.device_names)
    lockstep = Lockstep(settings, seed, recorder.take)
    header = header_of(settings, seed, Grade.SIM, 0) | {"drawn": json.dumps(drawn_values(lockstep.backend))}
    if log is not None:
        recorder.open(log, tables_of(lockstep.controller, lockstep.backend), header, settings.log.chunk_kib * 1024)
    operator = LockstepOperator(lockstep, recorder, plan)
    operator.log_parameters()
    failure: RtctlError | None = None
    lockstep.advance(1)  # loads the compiled loop, or compiles it, before the time counts
    try:
        insert_array(operator, settings, lockstep.controller.robot, report)
    except RtctlError as error:
        failure = error
    broken = failure_of(lockstep.backend)
    if broken is not None:  # what the script ran into is only what followed from it
        failure, state = broken
        if log is not None:
            log.with_suffix(FAILED_STEP_SUFFIX).write_bytes(state)
    lockstep.advance(LAST_TICKS)
    lockstep.command(Verb.DISABLE)
    lockstep.advance(LAST_TICKS)
    lockstep.close()
    recorder.close()
    records, truths = recorder.rows()
    recording = Recording(settings, header, records, truths, recorder.events, operator.path, 0, True)
    return Simulation(recording, failure, operator.loop_s)


class Recorder:
    """Keeps the rows of a lockstep run and what they tell, and writes them to a log if there is one."""

    def __init__(self, devices: Sequence[str] = ()) -> None:
        self.watcher = Watcher(devices)
        self.events: list[dict[str, Any]] = []
        self._writer: LogWriter | None = None
        self._blocks: list[tuple[np.ndarray, np.ndarray]] = []

    def open(self, path: Path, tables: dict[str, Table], header: dict[str, str], chunk_bytes: int) -> None:
        """Write a log from now on. Raises LogError if it exists or cannot be written."""
        self._writer = LogWriter(path, tables, header, chunk_bytes=chunk_bytes)

    def take(self, records: np.ndarray, truths: np.ndarray) -> None:
        """The sink of a :class:`rtctl.lockstep.Lockstep`."""
        self._blocks.append((records, truths))
        events = [msgspec.to_builtins(event) for event in self.watcher.watch(records)]
        self.events += events
        if self._writer is not None:
            self._writer.write_rows(CONTROLLER, records)
            self._writer.write_rows(TRUTH, truths)
            for event in events:
                self._writer.write_json(EVENTS, event["time_ns"], event)

    def document(self, topic: str, time_ns: int, content: Mapping[str, Any], record: np.ndarray) -> None:
        """Log a plan or a parameter set, with its bytes."""
        if self._writer is not None:
            self._writer.write_json(topic, time_ns, with_bytes(dict(content), record))

    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """All records and all truths so far."""
        records, truths = zip(*self._blocks, strict=True)
        return _joined(records), _joined(truths)

    def close(self) -> None:
        """Finish the log."""
        if self._writer is not None:
            self._writer.close()


def _joined(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """The rows of all blocks; as bytes, since numpy would reconcile the hundred fields of each block with the next's."""
    return np.concatenate([block.view(np.uint8) for block in blocks]).view(blocks[0].dtype)


class LockstepOperator:
    """An :class:`rtctl.workflow.Operator` for whom time passes only while it waits.

    known: the plan relative to the cochlea, if it is known already.
    """

    def __init__(self, lockstep: Lockstep, recorder: Recorder, known: Plan | None = None) -> None:
        self._lockstep, self._recorder, self._known = lockstep, recorder, known
        self._last: Any = None
        self._plans = 0
        self.path: np.ndarray | None = None
        """the plan in force, (1,) of dtype PATH"""
        self.loop_s = 0.0
        """wall time spent in the loop, planning excluded"""

    def log_parameters(self) -> None:
        """Log the parameter set that is in force from the first tick on."""
        parameters = self._lockstep.controller.memory["parameters"]
        content = {"number": int(parameters["number"][0]), "values": public_table(self._lockstep.controller.settings)}
        self._recorder.document(PARAMETERS, 0, content, parameters)

    def command(self, verb: Verb, *arguments: float) -> int:
        """Give one command in the next tick. Raises CommandRefused if the tick refuses it."""
        record = self._last = self._lockstep.command(verb, *arguments)
        reason = Reason(int(record["command_verdict"]))
        if reason is not Reason.ACCEPTED:
            text, remedy = explain(reason, float(record["reason_value"]), float(record["reason_bound"]))
            raise CommandRefused(reason.name.lower(), f"{verb.name.lower()} refused: {text}", remedy=remedy)
        return int(record["tick"])

    def wait(self, until: Predicate, timeout_s: float) -> Any:
        """Advance in small steps until `until` holds or `timeout_s` of virtual time are over."""
        end = self._lockstep.tick + round(timeout_s * 1e9 / self._lockstep.period_ns)
        while not until(self._last) and self._lockstep.tick < end:
            start = time.perf_counter()
            self._last = self._lockstep.advance(GLANCE_TICKS)
            self.loop_s += time.perf_counter() - start
        return self._last

    def plan(self, progress: Callable[[float], None]) -> int:
        """Plan from the registered entry; no virtual time passes meanwhile."""
        lockstep = self._lockstep
        controller, entry = lockstep.controller, self._last["pose_entry"]
        self._plans += 1
        self.path = make_plan(
            controller.settings,
            controller.robot,
            entry,
            self._plans,
            lambda done, total: progress(done / total),
            known=self._known,
        )
        content = {"number": self._plans, "pose_entry": entry.tolist()}
        self._recorder.document(PLANS, int(self._last["time_ns"]), content, self.path)
        controller.memory["staged_plan"] = self.path
        return self.command(Verb.LOAD_PLAN, float(self._plans))

    def causes(self, record: Any) -> list[Cause]:
        """Conditions in the operator's words, with the numbers they arose with."""
        known = self._recorder.watcher.causes
        return [Cause(*known.get(c, (say(c), TABLE[c].remedy))) for c in conditions_of(record)]
