"""A stand-in for the real-time process: takes commands and commits records like the tick, but moves nothing.

Operating states are those of the real lifecycle; a motion is busy for `busy_ticks`.
"""

import os
import threading
import time

import numpy as np

from rtctl.commands import COMMAND, Reason, Verb
from rtctl.electrode.path import PATH
from rtctl.exchange.control import (
    LOG_WRITING,
    OPERATOR_EXPECTED,
    OPERATOR_PRESENT,
    RealTimeState,
    Word,
    put,
)
from rtctl.exchange.mailbox import fetch
from rtctl.exchange.poll import new_poller, poll
from rtctl.exchange.ring import commit
from rtctl.lifecycle import Condition, Operating, step
from rtctl.log.format import CONTROLLER, TRUTH
from rtctl.memory import parameters_dtype

MOTION = (Verb.HOME, Verb.MOVE_CP, Verb.SERVO_CP, Verb.SERVO_CV, Verb.APPROACH, Verb.INSERT, Verb.RETRACT)


class RealTimeDouble:
    """Ticks on a thread every millisecond, as well as Python can."""

    def __init__(self, segment, tables, settings, dof, period_s=0.001):
        self.segment, self.settings, self.dof, self.period_s = segment, settings, dof, period_s
        self.row = np.zeros(1, tables[CONTROLLER].dtype)
        self.truth = np.zeros(1, tables[TRUTH].dtype) if TRUTH in tables else None
        self.command = np.zeros(1, COMMAND)
        self.plan = np.zeros(1, PATH)
        self.parameters = np.zeros(1, parameters_dtype(dof))
        self.poller = new_poller(segment.control)
        self.commands: list[np.void] = []
        self.extra_conditions = 0
        self.busy_ticks, self.busy_until = 100, 0
        self.mute = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._loop, daemon=True)
        r = self.row[0]
        r["pose_entry"] = r["pose_goal"] = np.nan
        r["fault_cause"] = r["condition_reported"] = -1
        r["parameter_set"] = 1

    def start(self, pid=None):
        put(self.segment.control, Word.REAL_TIME_PID, os.getpid() if pid is None else pid)
        put(self.segment.control, Word.REAL_TIME_STATE, RealTimeState.RUNNING)
        self._thread.start()

    def stop(self, state=RealTimeState.STOPPED):
        if self._thread.is_alive() and not self._stop.is_set():
            self._stop.set()
            self._thread.join()
            put(self.segment.control, Word.REAL_TIME_STATE, state)

    @property
    def tick(self):
        return int(self.row[0]["tick"])

    def _loop(self):
        tick, due = 0, time.monotonic()
        while not self._stop.is_set():
            if not self.mute:
                self.run_tick(tick)
            tick += 1
            due += self.period_s
            time.sleep(max(0.0, due - time.monotonic()))

    def run_tick(self, tick):
        r, c = self.row[0], self.command[0]
        r["tick"], r["time_ns"] = tick, time.time_ns()
        health = poll(self.segment.control, self.segment.mailbox, self.poller[0], c, 500)
        r["gateway_health"] = health
        active = self.extra_conditions
        if health & OPERATOR_EXPECTED and not health & OPERATOR_PRESENT:
            active |= 1 << Condition.OPERATOR_LOST
        if health and not health & LOG_WRITING:
            active |= 1 << Condition.LOG_FAILED
        new = active & ~int(r["condition_active"])
        r["condition_reported"] = new.bit_length() - 1
        r["condition_active"] = active
        verb = int(c["verb"])
        r["operating_state"], verdict = step(int(r["operating_state"]), active, verb, False)
        r["command_sequence"], r["command_verb"], r["command_source"] = c["sequence"], verb, c["source"]
        r["command_argument"], r["command_deadline_tick"] = c["argument"], c["deadline_tick"]
        r["command_verdict"], r["reason_value"], r["reason_bound"] = verdict, np.nan, np.nan
        if c["sequence"]:
            self.commands.append(self.command.copy()[0])
            if c["deadline_tick"] < tick:
                r["command_verdict"], r["reason_value"] = Reason.EXPIRED, tick - c["deadline_tick"]
            elif verdict == Reason.ACCEPTED:
                self.obey(tick, verb)
        r["is_busy"] = tick < self.busy_until and r["operating_state"] == Operating.ENABLED
        if verb == Verb.NONE and r["operating_state"] != Operating.ENABLED:
            self.busy_until = 0
        commit(self.segment.records, r)
        if self.truth is not None:
            self.truth[0]["time_ns"], self.truth[0]["tick"] = r["time_ns"], tick
            commit(self.segment.truths, self.truth[0])
        put(self.segment.control, Word.TICK, tick)

    def obey(self, tick, verb):
        r, c = self.row[0], self.command[0]
        if verb in MOTION:
            self.busy_until = tick + self.busy_ticks
        if verb == Verb.HOME:
            r["is_homed"] = 1
        elif verb == Verb.STOP:
            self.busy_until = 0
        elif verb == Verb.REGISTER_ENTRY:
            r["pose_entry"] = self.settings.workflow.entry_pose_mm_rad
        elif verb == Verb.LOAD_PLAN:
            number = int(c["argument"][0])
            assert fetch(self.segment.plans, int(c["slot"]), number, self.plan[0])
            r["plan_number"] = number
        elif verb == Verb.SET_PARAMETERS:
            number = int(c["argument"][0])
            assert fetch(self.segment.parameters, int(c["slot"]), number, self.parameters[0])
            r["parameter_set"] = number
