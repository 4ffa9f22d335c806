"""Black boxes around ticks over budget and faults, from a ring of our own; who looks at the machine is a double."""

import numpy as np
import pytest

from rtctl.attribution.evidence import Counters, Sighting, Thread
from rtctl.exchange.atomics import WORD
from rtctl.exchange.control import WORDS, Word, put
from rtctl.exchange.ring import commit, ring_shape
from rtctl.gateway.blackbox import BURST, KEPT, LOOKS, TICKS, BlackBoxes, event_of
from rtctl.gateway.events import Watcher
from rtctl.gateway.witness import Witness
from rtctl.lifecycle import Operating
from rtctl.record import controller_table

DTYPE = controller_table(3).dtype
PERIOD_NS, MS = 1_000_000, 1_000_000


class WitnessDouble:
    """Counts as the loop ticks, and sees it stopped whenever it is asked."""

    virtual = False

    def __init__(self):
        self.last, self.kept_off, self.looks = 0, [], 0

    def tick(self):
        return self.last

    def count(self, _core):
        return Counters(self.last, steal_ms=0.0, run_wait_ms=0.001 * self.last, interrupts={}, softirqs={})

    def look(self):
        self.looks += 1
        return Sighting(self.last, Thread(1, "python", "T", core=1, priority=80))

    def frequency_mhz(self, _core):
        return None

    def keep_off(self, core):
        self.kept_off.append(core)


class Bed:
    """A loop that commits what it is told, and boxes that watch it a few records at a time."""

    def __init__(self, capacity=1024):
        self.ring = np.zeros(ring_shape(DTYPE, capacity), WORD)
        self.witness, self.now_s, self.tick, self.position = WitnessDouble(), 100.0, 0, 0
        self.boxes = BlackBoxes(self.ring, DTYPE, self.witness, PERIOD_NS, lambda: self.now_s)
        self.frozen, self.watcher, self.events = [], Watcher(), []

    def run(self, ticks, **last):
        """So many ticks in budget, the last one with what is different about it."""
        r = np.zeros(ticks, DTYPE)
        r["tick"] = self.tick + np.arange(ticks)
        r["lateness_ns"], r["voluntary_switches"], r["core"], r["tick_ns"] = 20_000, 1, 1, 10_000
        r["pose_measured"], r["fault_cause"] = np.nan, -1
        for name, value in last.items():
            r[name][-1] = value
        for i in range(0, ticks, 7):
            rows = r[i : i + 7]
            for row in rows:
                commit(self.ring, row)
            self.position += len(rows)
            self.witness.last = int(rows["tick"][-1])
            self.now_s += 0.001 * len(rows)
            self.frozen += self.boxes.watch(rows, self.position)
            self.events += [self.boxes.of_fault(e) for e in self.watcher.watch(rows)]
        self.tick += ticks
        return self

    def silence(self, seconds):
        for _ in range(round(seconds / 0.004)):
            self.now_s += 0.004
            self.frozen += self.boxes.watch(np.zeros(0, DTYPE), self.position)


@pytest.fixture
def bed():
    return Bed().run(300)


def test_a_run_in_budget_has_no_box_and_no_look_at_the_process(bed):
    bed.run(2000)
    assert bed.frozen == bed.boxes.freeze() == []
    assert bed.witness.looks == 0
    assert bed.witness.kept_off == [1], "the gateway leaves the core of the loop once it knows it"


def test_a_tick_over_budget_freezes_the_ticks_before_and_after_it(bed):
    bed.run(40, lateness_ns=4 * MS)
    late = bed.tick - 1
    bed.run(TICKS - 8)
    assert not bed.frozen, "it waits for the ticks after it"
    bed.run(20)
    (box,) = bed.frozen
    assert box["tick"] == late
    assert box["rows"]["tick"] == list(range(late - TICKS, late + TICKS + 1))
    assert box["rows"]["lateness_ns"][TICKS] == 4 * MS
    assert len(box["rows"]["stage_ns"][0]) == 6
    assert box["over_budget"] == [late]
    assert box["evidence"]["counted"]["tick"] >= 1
    event = event_of(box)
    assert (event.tick, event.blackbox, event.kind, event.severity) == (late, late, "timing", "warning")
    assert event.text == box["text"]
    assert bed.boxes.box(late) is box
    assert bed.boxes.box(late + 1) is None
    assert bed.boxes.box() is None, "it is no fault"


def test_what_was_seen_during_the_silence_is_in_the_box_and_the_looks_are_few(bed):
    bed.silence(0.2)
    assert bed.witness.looks == LOOKS
    bed.run(1, lateness_ns=200 * MS).run(TICKS + 10)
    assert bed.frozen[0]["causes"] == ["stopped"]
    assert len(bed.frozen[0]["evidence"]["sightings"]) == LOOKS


def test_ticks_over_budget_within_a_box_are_counted_in_it(bed):
    bed.run(5, lateness_ns=4 * MS).run(9, tick_ns=2 * MS).run(TICKS + 10)
    (box,) = bed.frozen
    assert len(box["over_budget"]) == 2
    assert box["text"].endswith(f"1 more within {TICKS} ticks of it")


def test_a_storm_does_not_flood_and_what_is_left_out_is_counted(bed):
    storm = 40
    for _ in range(storm):
        bed.run(2 * TICKS, lateness_ns=3 * MS)
    bed.run(2 * TICKS)
    assert BURST <= len(bed.frozen) <= BURST + 2
    left = bed.boxes.left_out + sum(box["left_out"] for box in bed.frozen)
    assert left == storm - len(bed.frozen)
    assert bed.boxes.left_out > 0


def test_small_holds_do_not_hide_a_long_one(bed):
    for _ in range(20):
        bed.run(2 * TICKS, lateness_ns=MS // 2)
    few = len(bed.frozen)
    bed.run(1, lateness_ns=30 * MS).run(TICKS + 10)
    assert len(bed.frozen) == few + 1
    assert "30.0 ms late" in bed.frozen[-1]["text"]
    assert "before it have no black box" in bed.frozen[-1]["text"]


def test_what_happened_before_anybody_looked_is_only_counted():
    bed = Bed()
    bed.witness.last = 500
    bed.silence(0.004)
    bed.run(400, lateness_ns=5 * MS).run(2 * TICKS)
    assert bed.frozen == []
    assert bed.boxes.left_out == 1


def test_the_end_of_the_run_freezes_what_there_is(bed):
    bed.run(10, tick_ns=2 * MS).run(5)
    (box,) = bed.boxes.freeze()
    assert len(box["rows"]["tick"]) == TICKS + 1 + 5
    assert bed.boxes.freeze() == []


def test_a_box_whose_records_were_overwritten_is_given_up():
    bed = Bed(capacity=64).run(200)
    bed.run(1, tick_ns=2 * MS)
    for _ in range(64):
        commit(bed.ring, np.zeros(1, DTYPE)[0])
    assert bed.boxes.freeze() == []


def test_a_fault_carries_the_last_ticks_and_has_a_box_at_once(bed):
    bed.run(30, tick_ns=2 * MS, stage_ns=[0, 2 * MS, 0, 0, 0, 0]).run(11, operating_state=Operating.FAULT)
    fault = next(e for e in bed.events if e.text.startswith("state is fault"))
    assert fault.blackbox == fault.tick == bed.tick - 1
    assert fault.last["tick"] == list(range(fault.tick + 1 - TICKS, fault.tick + 1))
    assert fault.last["operating_state"][-2:] == [Operating.DISABLED, Operating.FAULT]
    assert fault.last["pose_measured"][0] == [None, None, None], "what is not known is null"
    early = bed.boxes.box()
    assert early["reason"] == "fault"
    assert early["rows"]["tick"][-1] == fault.tick
    assert "took 2.00 ms (at most 0.75 ms), 2.00 ms in read" in early["text"], (
        "a tick over budget just before it is part of the story"
    )
    bed.run(TICKS + 20)
    late = bed.boxes.box()
    assert late["signals"]["tick"] == list(range(fault.tick - TICKS, fault.tick + TICKS + 1))
    assert [b["reason"] for b in bed.frozen] == ["timing", "fault"]


def test_only_the_newest_boxes_are_kept_for_clients(bed):
    for _ in range(KEPT + 3):
        bed.now_s += 10.0
        bed.run(2 * TICKS, lateness_ns=3 * MS)
    bed.run(TICKS + 10)
    assert bed.boxes.box(bed.frozen[0]["tick"]) is None
    assert bed.boxes.box(bed.frozen[-1]["tick"]) is not None


STAT = "{pid} ({name}) {state} 1" + " 0" * 34 + " {core} {priority} {policy} 0 0 0"


@pytest.fixture
def machine(tmp_path):
    """A folder that looks like /proc, with the loop as process 7, and a witness."""

    def process(pid, name, state="R", core=1, priority=0, policy=0):
        folder = tmp_path / f"{pid}" / "task" / f"{pid}"
        folder.mkdir(parents=True, exist_ok=True)
        text = STAT.format(pid=pid, name=name, state=state, core=core, priority=priority, policy=policy)
        (folder / "stat").write_text(text)
        (tmp_path / f"{pid}" / "stat").write_text(text)

    process(7, "python", priority=80, policy=1)
    control = np.zeros(WORDS, np.int64)
    put(control, Word.REAL_TIME_PID, 7)
    put(control, Word.TICK, 123)
    put(control, Word.GARBAGE_COLLECTIONS, 2)
    return tmp_path, process, Witness(control, tmp_path, tmp_path)


def test_the_witness_reads_what_the_system_counts_for_the_core(machine):
    proc, _, witness = machine
    (proc / "stat").write_text("cpu 1 2\ncpu0 0 0 0 0 0 0 0 5 0 0\ncpu1 0 0 0 0 0 0 0 7 0 0\nintr 4 5\n")
    (proc / "7" / "schedstat").write_text("1000 2500000 3\n")
    (proc / "interrupts").write_text(
        "     CPU0   CPU1\n 24:  1  20  IO-APIC  5-edge  eth0\nLOC:  3  40  Local timer\nERR: 0\n"
    )
    (proc / "softirqs").write_text("     CPU0   CPU1\nNET_RX:  6  70\n")
    counters = witness.count(1)
    assert counters == Counters(123, 70.0, 2.5, {"eth0 (irq 24)": 20, "LOC": 40}, {"NET_RX": 70}, 2)
    assert witness.count(5).steal_ms is None


def test_the_witness_does_not_make_up_what_the_system_does_not_tell(machine):
    _, _, witness = machine
    assert witness.count(1) == Counters(123, None, None, None, None, 2)
    assert witness.frequency_mhz(1) is None
    assert not witness.virtual


def test_the_witness_sees_the_loop_and_who_may_displace_it(machine):
    _, process, witness = machine
    process(8, "a (strange) name", priority=90, policy=1)
    process(9, "batch")
    process(10, "deadline", policy=6)
    process(11, "elsewhere", core=0, priority=99, policy=1)
    seen = witness.look()
    assert (seen.tick, seen.loop.state, seen.loop.priority) == (123, "R", 80)
    assert sorted(t.name for t in seen.rivals) == ["a (strange) name", "deadline"]
    process(7, "python", state="T", priority=80, policy=1)
    assert witness.look().loop.state == "T"
    assert witness.look().rivals == (), "nobody displaces a thread that does not want its core"


def test_a_loop_that_is_gone_is_not_seen(machine):
    proc, _, witness = machine
    (proc / "7" / "stat").unlink()
    assert witness.look() is None


def test_the_search_for_rivals_ends_in_time(machine, monkeypatch):
    _, process, witness = machine
    process(8, "rival", priority=90, policy=1)
    monkeypatch.setattr("rtctl.gateway.witness.SCAN_S", -1.0)
    assert witness.look().rivals == ()
