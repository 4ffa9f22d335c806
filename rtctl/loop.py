"""Runs ticks on the grid clock between a backend and shared memory. Counts and records, never prints."""

from collections.abc import Callable
from typing import Any

import numpy as np

from hal.backend import Backend
from hal.kernel import Pointer, direct, kernel, specialised
from rtctl import clock as clocks
from rtctl import usage as usages
from rtctl.commands import COMMAND, Verb
from rtctl.controller import Controller
from rtctl.exchange.atomics import load_acquire, store_release
from rtctl.exchange.control import ARMING_ALLOWED, Word
from rtctl.exchange.mailbox import fetch, forget, is_empty
from rtctl.exchange.poll import listen, new_poller, poll
from rtctl.exchange.ring import commit
from rtctl.exchange.segment import Segment
from rtctl.stages import POLL, PREPARE, READ, RECORD, TICK
from rtctl.tick import tick as run_tick

CRUISE_S = 1.0
"""Longest time without the interpreter: a signal ends it at once, unless it comes while a tick computes."""
STOP_LIMIT_TICKS = 3000
"""A motion that has not come to rest this long after a request to end is cut off."""


class Loop:
    """The real-time loop of one controller.

    Args:
        controller, backend: what runs; the backend is open.
        segment: what the gateway sees.
        heartbeat_ticks: silence of the gateway after which it counts as dead.
        may_arm: whether enabling is allowed on this machine (its grade, or an explicit flag).
    """

    def __init__(
        self, controller: Controller, backend: Backend, segment: Segment, heartbeat_ticks: int, may_arm: bool
    ) -> None:
        self.controller, self.backend, self.segment = controller, backend, segment
        self.heartbeat_ticks = heartbeat_ticks
        self.permission = ARMING_ALLOWED if may_arm else 0
        self.poller = new_poller(segment.control)
        self.usage = np.zeros(1, usages.USAGE)
        truth = backend.truth()
        self.truth = truth[1] if truth is not None else None
        self.ending_since = -1
        self.cruise: Callable[..., int] | None = None
        self.cruise_arguments: tuple[Any, ...] = ()
        device = backend.compiled()
        if device is not None and self.truth is not None:
            memory = (
                controller.memory,
                controller.sensors,
                controller.actuators,
                controller.record,
                self.poller,
                self.usage,
            )
            exchange = segment.control, segment.mailbox, segment.records, segment.truths, self.truth
            hal = device.device, Pointer(device.read), Pointer(device.write)
            self.cruise_arguments = *memory, *exchange, *hal, self.heartbeat_ticks, self.permission
            self.cruise = direct(specialised(cruise, (clocks.grid(1.0), 0, *self.cruise_arguments)))
            self.cruise_ticks = round(CRUISE_S / controller.settings.loop.period_s)

    def run(self, clock: np.ndarray, ticks: int | None = None) -> None:
        """Run until somebody asks for a stop (control word STOP_REQUEST), or for `ticks` ticks; end without power."""
        last = None if ticks is None else int(clock["tick"][0]) + ticks
        ask_usage(self.usage)
        while last is None or clock["tick"][0] < last:
            if self.cruise is not None:
                ticks = self.cruise_ticks if last is None else min(self.cruise_ticks, last - int(clock["tick"][0]))
                if self.cruise(clock, ticks, *self.cruise_arguments) == 0:
                    continue
            if self.cycle(clock):
                return
        self.ending_since = int(clock["tick"][0])
        while not self.cycle(clock):
            pass

    def cycle(self, clock: np.ndarray) -> bool:
        """One tick. True when the loop has ended: at rest, and without power."""
        c, s = self.controller, self.segment
        verb = begin(
            clock, s.control, s.mailbox, self.poller, c.memory, c.record, self.heartbeat_ticks, self.permission
        )
        tick = int(clock["tick"][0])
        self.backend.read(tick, c.sensors)  # at once: a device's time belongs to the wake-up
        stamp(clock, c.record, READ)
        if self.ending_since >= 0 or must_end(s.control):
            verb = self._order_end(tick)
        if verb:
            self._prepare(verb, tick)
            stamp(clock, c.record, PREPARE)
        c.step()
        stamp(clock, c.record, TICK)
        self.backend.write(tick, c.actuators)
        finish(clock, c.sensors, c.record, self.usage, s.records, s.control)
        if self.truth is not None:
            publish_truth(c.record, self.truth, s.truths)
        stamp(clock, c.record, RECORD)
        return self.ending_since >= 0 and verb == Verb.DISABLE

    def _prepare(self, verb: int, tick: int) -> None:
        """What a command needs beside the tick: its staged data, or a motion profile."""
        memory, command = self.controller.memory, self.controller.command[0]
        number, slot = int(command["argument"][0]) if np.isfinite(command["argument"][0]) else -1, int(command["slot"])
        if verb == Verb.LOAD_PLAN:
            staged = memory["staged_plan"][0]
            if not fetch(self.segment.plans, slot, number, staged):
                staged["number"] = -1
        elif verb == Verb.SET_PARAMETERS:
            staged = memory["staged_parameters"][0]
            if not fetch(self.segment.parameters, slot, number, staged):
                staged["number"] = -1
        else:
            self.controller.propose(tick)

    def _order_end(self, tick: int) -> int:
        """Commands of the loop itself on its way out: stop, and once at rest (or too late) disable."""
        if self.ending_since < 0:
            self.ending_since = tick
        record = self.controller.record[0]
        row = np.zeros(1, COMMAND)
        resting = not record["is_busy"] and tick > self.ending_since
        verb = Verb.DISABLE if resting or tick - self.ending_since > STOP_LIMIT_TICKS else Verb.STOP
        row["verb"], row["deadline_tick"] = verb, tick
        self.controller.order(row[0])
        return int(verb)


def cruise(
    clock,
    ticks,
    memory,
    sensors,
    actuators,
    record,
    poller,
    usage,
    control,
    mailbox,
    records,
    truths,
    truth,
    device,
    read,
    write,
    heartbeat_ticks,
    permission,
):
    """Up to `ticks` ticks without the interpreter, as long as nobody wants anything; see :meth:`Loop.cycle`.

    Returns how many ticks are left: 0 at the end or after a signal, else somebody wants something. A command that comes while a tick is awaited
    stays in the mailbox for the next one. A kernel once :class:`Loop` has compiled it for a device of kernels.
    """
    clock[0].interrupted = 0
    while ticks > 0 and not clock[0].interrupted:
        if must_end(control) or not is_empty(mailbox):
            return ticks
        clocks.wait(clock[0], record[0])
        record[0].gateway_health = listen(control, poller[0], heartbeat_ticks) | permission
        forget(memory[0].command)
        record[0].stage_ns[PREPARE] = 0
        stamp(clock, record, POLL)
        read(device[0], record[0].tick, sensors[0])
        stamp(clock, record, READ)
        run_tick(memory[0], sensors[0], actuators[0], record[0])
        stamp(clock, record, TICK)
        write(device[0], record[0].tick, actuators[0])
        finish(clock, sensors, record, usage, records, control)
        publish_truth(record, truth, truths)
        stamp(clock, record, RECORD)
        ticks -= 1
    return 0


@kernel
def must_end(control):
    """Somebody asks the loop to end."""
    return load_acquire(control, Word.STOP_REQUEST) != 0


@kernel
def begin(clock, control, mailbox, poller, memory, record, heartbeat_ticks, permission):
    """Wait for the grid point, stamp the record, and look at the gateway once. Returns the verb of the command."""
    clocks.wait(clock[0], record[0])
    record[0].gateway_health = poll(control, mailbox, poller[0], memory[0].command, heartbeat_ticks) | permission
    record[0].stage_ns[PREPARE] = 0
    clocks.stamp(clock[0], record[0], POLL)
    return memory[0].command.verb


@kernel
def stamp(clock, record, stage):
    """End a stage. That of RECORD ends when the record is gone: it travels with the next one."""
    clocks.stamp(clock[0], record[0], stage)


@kernel
def ask_usage(usage):
    """Begin to count what the loop's thread costs the system."""
    usages.ask(usage[0])


@kernel
def finish(clock, sensors, record, usage, records, control):
    """Follow the device, stamp the duration, put the record into the ring, and update the words others watch."""
    r = record[0]
    clocks.follow(clock[0], sensors[0].device_time_s, r)
    clocks.stamp_duration(clock[0], r)
    usages.note(usage[0], r)
    commit(records, r)
    store_release(control, Word.TICK, r.tick)
    if r.missed_ticks > 0:
        store_release(control, Word.OVERRUNS, load_acquire(control, Word.OVERRUNS) + 1)
        store_release(control, Word.MISSED_TICKS, load_acquire(control, Word.MISSED_TICKS) + r.missed_ticks)
    if r.lateness_ns > load_acquire(control, Word.MAX_LATENESS_NS):
        store_release(control, Word.MAX_LATENESS_NS, r.lateness_ns)


@kernel
def publish_truth(record, truth, truths):
    """Put what the simulation knows into its own ring, stamped like the record."""
    truth[0].time_ns = record[0].time_ns
    truth[0].tick = record[0].tick
    commit(truths, truth[0])
