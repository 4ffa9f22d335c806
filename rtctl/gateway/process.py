"""The thread that drains: records into the log, news to the network, a heartbeat to the tick.

Nothing in this loop waits for anybody. What may take long (requests, replies, planning) has threads of its own.
"""

import logging
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hal.backend import load
from rtctl.controller import Controller
from rtctl.electrode.path import PATH
from rtctl.exchange.control import RealTimeState, Word, get, put
from rtctl.exchange.mailbox import fetch
from rtctl.exchange.ring import RingReader, committed
from rtctl.exchange.segment import Segment
from rtctl.gateway import messages
from rtctl.gateway.commander import Commander
from rtctl.gateway.desk import Desk
from rtctl.gateway.events import Event, Watcher
from rtctl.gateway.feedback import Feedback, operating_state
from rtctl.gateway.journal import Journal, next_path, with_bytes
from rtctl.gateway.lease import Lease
from rtctl.gateway.network import Network
from rtctl.gateway.parameters import Parameters
from rtctl.gateway.run import Run
from rtctl.gateway.scopes import Scopes
from rtctl.gateway.setup import exercise, header_of, tables_of
from rtctl.gateway.watch import ProcessWatch
from rtctl.handover import layout
from rtctl.log.format import CONTROLLER, EVENTS, PARAMETERS, PLANS, TRUTH
from rtctl.memory import parameters_dtype
from rtctl.record import CDR_HEADER
from rtctl.settings import Settings

DRAIN_S = 0.004
"""Rest between two rounds when nothing is left to drain."""
SLOW_S = 1.0
"""Keys that are published on change are repeated after this time, for clients that come late."""
SHOWN = ("operating_state", "task_state", "condition_active", "is_homed", "is_busy")
NOTHING = np.zeros(0)
EXIT_OK, EXIT_REAL_TIME_DIED = 0, 3

log = logging.getLogger(__name__)


class Gateway:
    """One gateway process. :meth:`serve` returns its exit code."""

    def __init__(self, memory_fd: int, settings: Settings, directory: Path, seed: int) -> None:
        """Attach to the shared memory, begin a log file, go on the network.

        Raises:
            LayoutError: the shared memory is not of these settings.
            NetworkError: the endpoint cannot be opened.
        """
        choice = settings.backend  # asked what a simulation knows, never opened
        backend = load(choice.name, choice.options, period_s=settings.loop.period_s, seed=seed)
        controller = Controller(settings)
        robot, tables, memory = controller.robot, tables_of(controller, backend), layout(controller, backend)
        exercise(settings, robot, memory)
        segment = Segment.attach(memory_fd, memory)
        self._control = segment.control
        self._readers = [_Channel(segment, topic, table.dtype) for topic, table in tables.items()]
        header = header_of(settings, seed, get(self._control, Word.GRADE), self._readers[0].first_tick())
        journal = Journal(next_path(directory), tables, header, settings.log.chunk_kib * 1024)
        self._run = Run(
            settings=settings,
            robot=robot,
            segment=segment,
            journal=journal,
            commander=Commander(segment, settings.loop.period_s),
            lease=Lease(settings.gateway.lease_s),
            parameters=Parameters(settings, robot, directory),
            watcher=Watcher(choice.device_names),
            scopes=Scopes(tables),
        )
        self._feedback = Feedback(tables[CONTROLLER])
        self._desk = Desk(self._run)
        self._network = Network(settings.robot.name, settings.gateway, self._desk.answer)
        self._run.say_health()  # before the first heartbeat makes anybody believe it
        self._watch = ProcessWatch()
        self._state_s, self._next_state_s = 1.0 / settings.gateway.state_rate_hz, 0.0
        self._shown: list[Any] = []
        self._shown_s = 0.0
        self._stopping = self._failure_told = False
        self.longest_gap_s = 0.0
        """longest time between two heartbeats so far"""

    def stop(self) -> None:
        """End :meth:`serve` after everything committed so far is logged. Safe in a signal handler."""
        self._stopping = True

    def serve(self) -> int:
        """Drain until the run is over; 0, or 3 if the real-time process died without saying so."""
        last_s = time.monotonic()
        while True:
            over = self._stopping or get(self._control, Word.REAL_TIME_STATE) >= RealTimeState.STOPPED
            died = not over and self._watch.died(get(self._control, Word.REAL_TIME_PID))
            drained = self._round()
            now_s = time.monotonic()
            self.longest_gap_s, last_s = max(self.longest_gap_s, now_s - last_s), now_s
            if not drained:
                if over or died:
                    return self._finish(died and not self._ended())
                time.sleep(DRAIN_S)

    def _ended(self) -> bool:
        return get(self._control, Word.REAL_TIME_STATE) >= RealTimeState.STOPPED

    def _round(self) -> int:
        """Everything once: heartbeat, drain, events, lease, health, publications. Returns the records drained."""
        run, now_s = self._run, time.monotonic()
        put(self._control, Word.GATEWAY_HEARTBEAT, get(self._control, Word.GATEWAY_HEARTBEAT) + 1)
        size = run.journal.size_bytes
        drained, fresh = 0, dict.fromkeys((CONTROLLER, TRUTH), NOTHING)
        for reader in self._readers:
            rows = fresh[reader.topic] = reader.read()
            drained += len(rows)
            if reader.topic == CONTROLLER and len(rows):
                self._deal_with(rows)
            run.journal.rows(reader.topic, rows)
            lost = reader.newly_lost()
            if lost:
                run.tell("records", f"{lost} rows of {reader.topic} were overwritten before they were logged",
                         "relieve the machine or raise log.ring_rows", "error")  # fmt: skip
        if run.journal.size_bytes != size or run.journal.failure:
            for reader in self._readers:
                reader.settle()
        run.scopes.feed(fresh[CONTROLLER], fresh[TRUTH])
        run.commander.expire(now_s)
        busy = run.latest is not None and bool(run.latest["is_busy"])
        silent = run.lease.expire(busy, now_s)
        if silent:
            run.tell("lease", f"{silent} lost the lease: it was silent", "start the client again", "warning")
        self._tell_failure()
        self._run.say_health()
        while not run.told.empty():
            self._emit(run.told.get())
        self._publish(now_s)
        return drained

    def _deal_with(self, rows: np.ndarray) -> None:
        """Events, verdicts and the newest record; before the first one, what was in force when this log began."""
        run = self._run
        if run.latest is None:
            self._log_in_force(rows[0])
        for event in run.watcher.watch(rows):
            self._emit(event)
        run.latest = rows[-1].copy()
        run.commander.resolve(rows)

    def _log_in_force(self, row: Any) -> None:
        """Parameter set and plan of the first record of this log, so that it can be replayed from its first row."""
        run, stamp = self._run, int(row["time_ns"])
        number = int(row["parameter_set"])
        parameters = _staged(run.segment.parameters, number, parameters_dtype(run.robot.dof))
        if parameters is None:
            parameters = run.parameters.packed(run.parameters.settings, number)
        content = {"number": number, "values": run.parameters.live_values(run.parameters.settings)}
        run.journal.document(PARAMETERS, stamp, with_bytes(content, parameters))
        plan = _staged(run.segment.plans, int(row["plan_number"]), PATH)
        if plan is not None:
            run.journal.document(PLANS, stamp, with_bytes({"number": int(row["plan_number"])}, plan))

    def _tell_failure(self) -> None:
        if self._run.journal.failure and not self._failure_told:
            self._failure_told = True
            self._run.tell("log", self._run.journal.failure, "free space on the disk of the log and restart", "error")

    def _emit(self, event: Event) -> None:
        payload = messages.encode(event)
        self._run.journal.document(EVENTS, event.time_ns, msgspec.to_builtins(event))
        self._network.publish("events", payload)

    def _publish(self, now_s: float) -> None:
        run = self._run
        if run.latest is None or now_s < self._next_state_s:
            return
        self._next_state_s = max(self._next_state_s + self._state_s, now_s)
        row, holder = run.latest, run.lease.holder
        self._network.publish("record", CDR_HEADER + row.tobytes())
        for key, payload in self._feedback.payloads(row).items():
            self._network.publish(key, messages.encode(payload))
        shown = [holder, *(int(row[name]) for name in SHOWN)]
        if shown != self._shown or now_s - self._shown_s > SLOW_S:
            self._shown, self._shown_s = shown, now_s
            state = operating_state(row, get(self._control, Word.GRADE), holder, run.watcher.causes)
            self._network.publish("operating_state", messages.encode(state))
            lease = {"holder": holder or None, "lease_s": run.lease.duration_s}
            self._network.publish("lease", messages.encode(lease))

    def _finish(self, died: bool) -> int:
        """Say how it ended, close the log, leave the network."""
        run = self._run
        if died:
            text = "real-time process died; the device's watchdog removes power"
            run.tell("process", text, "look at its output in the folder of the run, then start again", "error")
        else:
            run.tell("process", "the run is over" if self._ended() else "the gateway was asked to end")
        self._desk.close()
        self._round()
        run.journal.close()
        for reader in self._readers:
            reader.settle(all_of_it=True)
        self._watch.close()
        self._network.close()
        log.info("longest gap between two heartbeats: %.1f ms", 1e3 * self.longest_gap_s)
        return EXIT_REAL_TIME_DIED if died else EXIT_OK


class _Channel:
    """A ring on its way into the log: how far it was read, how far a successor need not read again."""

    def __init__(self, segment: Segment, topic: str, dtype: np.dtype) -> None:
        if topic == CONTROLLER:
            ring, position, lost = segment.records, Word.RECORD_POSITION, Word.LOST_RECORDS
        else:
            assert segment.truths is not None
            ring, position, lost = segment.truths, Word.TRUTH_POSITION, Word.LOST_TRUTHS
        self.topic, self._ring, self._dtype, self._control = topic, ring, dtype, segment.control
        self._position_word, self._lost_word = position, lost
        self._reader = RingReader(ring, dtype, position=int(get(segment.control, position)))
        self._before = self._reader.position
        self._lost_before, self._told = int(get(segment.control, lost)), 0

    def first_tick(self) -> int:
        """Tick of the first record there is to read; of the next one if there is none."""
        if committed(self._ring) == 0:
            return 0
        rows = RingReader(self._ring, self._dtype, limit=1, position=self._reader.position).read()
        return int(rows[0]["tick"]) if len(rows) else int(get(self._control, Word.TICK)) + 1

    def read(self) -> np.ndarray:
        """The next records."""
        self._before = self._reader.position
        return self._reader.read()

    def newly_lost(self) -> int:
        """Records missed since the last call."""
        new, self._told = self._reader.lost - self._told, self._reader.lost
        if new:
            put(self._control, self._lost_word, self._lost_before + self._reader.lost)
        return new

    def settle(self, all_of_it: bool = False) -> None:
        """Tell a successor where to go on: the file grew, so all rounds before this one are in there."""
        put(self._control, self._position_word, self._reader.position if all_of_it else self._before)


def _staged(slots: np.ndarray, number: int, dtype: np.dtype) -> np.ndarray | None:
    """Payload `number` (1,) if a staging slot still holds it."""
    record = np.zeros(1, dtype)
    found = number > 0 and fetch(slots, number % slots.shape[0], number, record[0])
    return record if found else None
