"""The loop itself: its stage times add up, and a hundred thousand ticks allocate nothing."""

import gc
import sys

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from hal.backend import load as load_backend
from rtctl import clock as clocks
from rtctl.controller import Controller
from rtctl.exchange.ring import RingReader
from rtctl.exchange.segment import Segment
from rtctl.handover import layout
from rtctl.lockstep import Lockstep
from rtctl.loop import Loop
from rtctl.record import TIMING
from rtctl.settings import load
from rtctl.stages import PREPARE, READ, RECORD, TICK

TICKS, WITH_A_CLOCK = 100_000, 10_000
FEW = 10


@pytest.fixture(scope="module")
def settings():
    return load("planar-sim")


@pytest.fixture(scope="module")
def loop(settings):
    """A loop on the plant that has run a little, both ways."""
    backend = load_backend("plant", settings.backend.options, period_s=settings.loop.period_s, seed=1)
    controller = Controller(settings)
    made = Loop(controller, backend, Segment.create(layout(controller, backend)), 500, True)
    backend.open()
    made.run(clocks.grid(0.001), ticks=5)
    made.ending_since = -1
    for _ in range(3):
        made.cycle(clocks.grid(0.001))
    return made


@pytest.fixture
def hurried():
    """A grid so fine that the next point has always passed: the loop never sleeps."""
    return clocks.grid(1e-9)


def committed(loop, count):
    """The newest records of the loop."""
    ring = loop.segment.records
    return RingReader(ring, loop.segment.layout.record, limit=count, position=int(ring[0, 0]) - count).read()


@pytest.mark.parametrize("way", ["compiled", "interpreted"])
def test_the_stages_of_a_tick_add_up_to_it_and_the_record_is_that_of_the_tick_before(loop, hurried, way):
    for _ in range(20):
        loop.cruise(hurried, 1, *loop.cruise_arguments) if way == "compiled" else loop.cycle(hurried)
    rows = committed(loop, 20)
    stages = rows["stage_ns"]
    assert (stages[:, :RECORD].sum(axis=1) == rows["tick_ns"]).all(), "no time of a tick is in no stage"
    assert (stages[:, (READ, TICK)] > 0).all()
    assert (stages[1:, RECORD] > 0).all()
    assert (stages[:, PREPARE] == 0).all(), "there was no command"
    assert (rows["core"] >= 0).all()
    last = int(loop.controller.record["stage_ns"][0, RECORD])
    loop.cycle(hurried)
    assert committed(loop, 1)["stage_ns"][0, RECORD] == last


def test_faults_and_switches_are_counted_from_tick_to_tick(loop):
    slow = clocks.grid(0.002)
    loop.cruise(slow, 5, *loop.cruise_arguments)
    rows = committed(loop, 5)
    assert (rows["voluntary_switches"] >= 1).all(), "it slept before every tick"
    fresh = np.empty(64 << 20, np.uint8)
    fresh[::4096] = 1  # touches pages that have never been there
    loop.cruise(slow, 1, *loop.cruise_arguments)
    assert committed(loop, 1)["minor_faults"][0] > 10
    loop.cruise(slow, 1, *loop.cruise_arguments)
    assert committed(loop, 1)["minor_faults"][0] < 10


def test_lockstep_measures_nothing(settings):
    rows = []
    lockstep = Lockstep(settings, 1, sink=lambda records, _truths: rows.append(records))
    lockstep.advance(50)
    lockstep.close()
    assert all(not rows[0][name].any() for name in TIMING)


def allocations(call):
    """What numba's run-time system has given out in one call: (blocks, arrays)."""
    before = rtsys.get_allocation_stats()
    call()
    after = rtsys.get_allocation_stats()
    return after.alloc - before.alloc, after.mi_alloc - before.mi_alloc


@pytest.fixture
def counting():
    """numba counts its allocations; it does not unless asked."""
    _nrt_python.memsys_enable_stats()
    yield
    _nrt_python.memsys_disable_stats()


@pytest.mark.usefixtures("counting")
def test_the_compiled_loop_with_its_clock_and_its_ring_allocates_nothing(loop, hurried):
    """What a call from Python allocates is the arguments', however many ticks it runs."""
    few = allocations(lambda: loop.cruise(hurried, FEW, *loop.cruise_arguments))
    assert few[1] > 0, "the counters count"
    many = allocations(lambda: loop.cruise(hurried, WITH_A_CLOCK, *loop.cruise_arguments))
    assert many == few


@pytest.mark.usefixtures("counting")
def test_a_hundred_thousand_ticks_in_lockstep_allocate_nothing_but_their_rows(settings):
    lockstep = Lockstep(settings, 1)
    lockstep.advance(FEW)
    few = allocations(lambda: lockstep.run(*lockstep._arguments(FEW)))
    block = Lockstep.BLOCK - FEW
    lockstep.advance(1)
    for _ in range(-(-TICKS // block)):
        lockstep._rows = 0
        assert allocations(lambda: lockstep.run(*lockstep._arguments(block))) == few
    lockstep.close()


def test_ticks_through_the_interpreter_leave_nothing_behind(loop, hurried):
    def cycles(count):
        for _ in range(count):
            loop.cycle(hurried)

    cycles(50)
    gc.disable()
    try:
        before = sys.getallocatedblocks()
        cycles(5000)
        grown = sys.getallocatedblocks() - before
    finally:
        gc.enable()
    assert grown < FEW, "objects that would have to be collected"
