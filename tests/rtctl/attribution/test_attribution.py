"""Every cause is made to happen in records and samples of our own, and the words name it; a tick in budget is left alone."""

import numpy as np
import pytest

from rtctl.attribution.budget import BETWEEN, WAKE_UP, bounds_ns, longest_part, over_budget
from rtctl.attribution.evidence import Counters, Evidence, Sighting, Thread
from rtctl.attribution.verdict import explain
from rtctl.record import controller_table
from rtctl.stages import POLL, PREPARE, READ, RECORD, STAGES, TICK, TICK_SHARE, WRITE

PERIOD_NS, AT = 1_000_000, 20
US, MS = 1_000, 1_000_000
LOOP = Thread(100, "python", "R", core=1, priority=80)


def rows(**at):
    """Forty ticks that went well, and what is different in the middle one; stages by name."""
    r = np.zeros(40, controller_table(3).dtype)
    r["tick"] = 5000 + np.arange(len(r))
    r["lateness_ns"], r["voluntary_switches"], r["core"] = 20 * US, 1, 1
    r["stage_ns"][:] = 2 * US
    r["stage_ns"][:, PREPARE] = 0
    for name, value in at.items():
        names = [s.name for s in STAGES]
        if name in names:
            r["stage_ns"][AT, names.index(name)] = value
        else:
            r[name][AT] = value
    r["tick"][AT:] += r["missed_ticks"][AT]
    r["tick_ns"] = r["stage_ns"][:, :RECORD].sum(axis=1)
    return r


def said(r, evidence=None):
    assert over_budget(r, PERIOD_NS)[AT]
    return explain(r, AT, evidence or Evidence(), PERIOD_NS)


def counted(ticks=100, **values):
    return Counters(tick=ticks, **values)


def test_ticks_in_budget_are_not_judged():
    longest, latest = bounds_ns(PERIOD_NS)
    assert not over_budget(rows(), PERIOD_NS).any()
    assert not over_budget(rows(lateness_ns=latest, record=longest), PERIOD_NS).any()
    assert over_budget(rows(lateness_ns=latest + 1), PERIOD_NS).sum() == 1
    assert over_budget(rows(record=longest + 1), PERIOD_NS).sum() == 1


def test_grid_points_missed_count_once_and_not_before_the_first_tick():
    r = rows(lateness_ns=5 * MS)
    r["missed_ticks"][AT + 1] = 4
    r["tick"][AT + 1 :] += 4
    assert np.flatnonzero(over_budget(r, PERIOD_NS)).tolist() == [AT], "the tick that was late, not the one after it"
    assert np.flatnonzero(over_budget(rows(missed_ticks=1), PERIOD_NS)).tolist() == [AT], "unless nothing else tells"
    first = rows()
    first["tick"] -= first["tick"][0] - 37
    first["missed_ticks"][0] = 37
    assert not over_budget(first, PERIOD_NS).any(), "before the loop began there was no tick to be late"


@pytest.mark.parametrize(
    ("change", "part", "tick"),
    [
        ({"lateness_ns": 3 * MS}, WAKE_UP, 5020),
        ({"read": 3 * MS}, "read", 5020),
        ({"prepare": 3 * MS}, "prepare", 5020),
        ({"record": 3 * MS}, "record", 5019),
        ({"missed_ticks": 2}, BETWEEN, 5019),
        ({"missed_ticks": 2, "record": 2 * MS}, "record", 5019),
    ],
)
def test_the_longest_part_is_found_and_its_tick(change, part, tick):
    r = rows(**change)
    hold = longest_part(r[AT - 1], r[AT], PERIOD_NS)
    assert (hold.part, hold.tick) == (part, tick)
    assert hold.held_ns >= 1.9 * MS


def test_a_driver_that_waits_is_named_with_its_stage_and_its_share():
    verdict = said(rows(read=1_700 * US, write=180 * US, voluntary_switches=2))
    assert verdict.causes == ("slept",)
    assert verdict.text.startswith("tick 5020 took 1.88 ms (at most 0.75 ms), 1.70 ms in read (the devices' sensors)")
    assert "went to sleep once in read: the driver of a device waited" in verdict.text


def test_a_driver_that_works_too_long_is_told_from_one_that_waits():
    verdict = said(rows(write=2 * MS))
    assert verdict.causes == ("worked",)
    assert "the driver of a device worked that long" in verdict.text
    assert "the interpreter worked" in said(rows(missed_ticks=1)).text
    assert "the planner worked" in said(rows(prepare=MS)).text


def test_a_stopped_process_is_known_by_its_state_or_by_a_sleep_too_many():
    stopped = Sighting(5019, Thread(100, "python", "T", core=1, priority=80))
    verdict = said(rows(lateness_ns=20 * MS), Evidence(sightings=(stopped,)))
    assert verdict.causes == ("stopped",)
    assert "was seen stopped" in verdict.text
    unseen = said(rows(lateness_ns=20 * MS, voluntary_switches=2))
    assert unseen.causes == ("stopped",)
    assert said(rows(tick=20 * MS, voluntary_switches=2)).causes == ("stopped",), "compiled code never sleeps by itself"


def test_what_was_seen_at_another_tick_says_nothing():
    stopped = Sighting(4900, Thread(100, "python", "T", core=1, priority=80))
    assert said(rows(lateness_ns=20 * MS), Evidence(sightings=(stopped,))).causes == ()


def test_a_device_that_sleeps_in_every_tick_does_not_look_like_a_stopped_process():
    r = rows(lateness_ns=20 * MS)
    r["voluntary_switches"] = 3
    assert said(r).causes == ()


def test_who_ran_in_its_place_is_named_if_he_was_seen_and_may_do_so():
    rival = Thread(4711, "chrt", "R", core=1, priority=90)
    harmless = (
        Thread(1, "batch", "R", core=1, priority=0),
        Thread(2, "other core", "R", core=0, priority=99),
        Thread(3, "asleep", "S", core=1, priority=99),
    )
    verdict = said(rows(lateness_ns=10 * MS), Evidence(sightings=(Sighting(5019, LOOP, (*harmless, rival)),)))
    assert verdict.causes == ("displaced",)
    assert "chrt (pid 4711, real-time priority 90) ran on core 1 in its place" in verdict.text
    assert not any(name in verdict.text for name in ("batch", "other core", "asleep"))
    assert said(rows(lateness_ns=10 * MS), Evidence(sightings=(Sighting(5019, LOOP, harmless),))).causes == ()


def test_losing_the_core_is_told_by_switches_and_by_the_run_queue():
    verdict = said(rows(tick=3 * MS, involuntary_switches=2), Evidence(counted(run_wait_ms=2.9)))
    assert "another thread took core 1 away from it 2 times (run-queue wait 2.9 ms)" in verdict.text
    late = rows(lateness_ns=3 * MS)
    assert said(late, Evidence(counted(run_wait_ms=2.1))).causes == ("displaced",)
    assert said(late, Evidence(counted(run_wait_ms=0.3))).causes == ()
    usual = counted(200, run_wait_ms=4.0)
    assert said(late, Evidence(counted(run_wait_ms=2.1), usual)).causes == (), (
        "it waits so long in 100 ticks that go well"
    )


def test_page_faults_explain_what_they_can():
    verdict = said(rows(prepare=900 * US, minor_faults=80))
    assert "80 page faults in prepare" in verdict.text
    assert verdict.causes == ("page faults",)
    few = said(rows(lateness_ns=9 * MS, minor_faults=3))
    assert few.causes == ()
    assert "3 page faults, too few to explain it" in few.text
    assert said(rows(tick=9 * MS, major_faults=1)).causes == ("disk",)


def test_a_host_that_steals_enough_is_named():
    late = rows(lateness_ns=3 * MS)
    verdict = said(late, Evidence(counted(40, steal_ms=10.0)))
    assert verdict.causes == ("stolen",)
    assert "the host stole 10 ms from core 1 within 40 ticks, in steps of 10 ms" in verdict.text
    assert said(rows(lateness_ns=40 * MS), Evidence(counted(steal_ms=10.0))).causes == ()


def test_a_collector_that_was_switched_on_is_named():
    verdict = said(rows(read=MS, voluntary_switches=1), Evidence(counted(collections=2)))
    assert verdict.causes[0] == "collected"
    assert "collected garbage, 2 times" in verdict.text


def test_interrupts_moves_and_slow_cores_are_hints_and_no_more():
    r = rows(lateness_ns=MS)
    r["core"][AT:] = 0
    evidence = Evidence(
        counted(100, interrupts={"eth0 (irq 30)": 900, "timer": 100}, softirqs={"NET_RX": 40}),
        counted(200, interrupts={"eth0 (irq 30)": 20, "timer": 200}, softirqs={"NET_RX": 0}),
        frequency_mhz=(1200.0, 3600.0),
    )
    verdict = said(r, evidence)
    assert verdict.causes == ()
    assert "nothing visible from here explains it" in verdict.text
    assert "eth0 (irq 30) 900 (usually 10)" in verdict.text
    assert "timer" not in verdict.text
    assert "NET_RX" not in verdict.text
    assert "moved from core 1 to 0" in verdict.text
    assert "1200 of 3600 MHz" in verdict.text


def test_nothing_found_is_said_with_whom_to_suspect_and_what_could_not_be_read():
    late = rows(lateness_ns=3 * MS)
    assert "on bare metal suspect SMI" in said(late).text
    assert "this is a virtual machine: suspect its host" in said(late, Evidence(virtual=True)).text
    assert "counters were not read in time" in said(late).text
    partly = said(late, Evidence(counted(steal_ms=0.0, interrupts={})))
    assert "not to be read on this kernel: run-queue wait" in partly.text
    assert "steal" not in partly.text


def test_grid_points_missed_afterwards_belong_to_the_story():
    r = rows(read=3 * MS)
    r["missed_ticks"][AT + 1] = 2
    r["tick"][AT + 1 :] += 2
    assert "in read (the devices' sensors), 2 grid points missed" in said(r).text


def test_counters_that_are_not_known_stay_unknown():
    before, now = (
        Counters(10, steal_ms=5.0, interrupts={"a": 3}),
        Counters(30, run_wait_ms=2.0, interrupts={"a": 5, "b": 1}),
    )
    assert now.since(before) == Counters(20, interrupts={"a": 2, "b": 1})


def test_the_budgets_of_the_stages_are_the_share_of_a_period_of_1_khz():
    assert [s.name for s in STAGES] == ["poll", "read", "prepare", "tick", "write", "record"]
    assert tuple(range(len(STAGES))) == (POLL, READ, PREPARE, TICK, WRITE, RECORD)
    assert sum(s.budget_us for s in STAGES) == 1000.0 * TICK_SHARE
    assert all(s.reason and s.what for s in STAGES)
