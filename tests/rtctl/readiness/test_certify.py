"""Certifying: rounds that are whole or not counted, promises, load, what the loop does meanwhile, and the page."""

import time
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from hal.errors import RtctlError
from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.commands import Verb
from rtctl.exchange.control import Grade
from rtctl.readiness import certificate, certify, cyclictest, operation, rounds
from rtctl.readiness.boxes import KEPT as KEPT_BOXES
from rtctl.readiness.boxes import UNEXPLAINED, Boxes
from rtctl.readiness.direct import RunError
from rtctl.readiness.doctor import Diagnosis
from rtctl.readiness.facts import Facts
from rtctl.readiness.finding import unknown
from rtctl.readiness.load import KINDS, Load, LoadError
from rtctl.readiness.measured import Distribution, process_table, ratios
from rtctl.readiness.overruns import BETWEEN, TICK, WAKE_UP, Overruns
from rtctl.readiness.rounds import LoopRound, Plan
from rtctl.readiness.times import Times
from rtctl.readiness.usage import Usage, usage_of
from rtctl.readiness.verdicts import BROKEN, KEPT, UNPROVEN
from rtctl.report.certificate import page
from rtctl.settings import load
from rtctl.simulation import LockstepOperator, Recorder

PERIOD_NS = 1_000_000
VOID = {"meta", "br"}
ROW = np.dtype([("tick", "i8"), ("missed_ticks", "i4"), ("lateness_ns", "i4"), ("tick_ns", "i4")])


def rows_of(*lines):
    return np.array(list(lines), ROW)


def times_of(*times_ns) -> Times:
    times = Times()
    times.add(np.array(times_ns))
    return times


def test_overruns_are_counted_over_blocks_and_told_by_their_longest_part():
    found = Overruns(PERIOD_NS, number=3)
    found.see(rows_of((0, 7, 10_000, 5_000), (1, 0, 10_000, 1_200_000)))
    found.see(rows_of((3, 1, 2_300_000, 5_000), (6, 2, 10_000, 5_000)))
    found.see(rows_of((8, 1, 10_000, 5_000), (9, 0, 10_000, 5_000)))
    told = found.as_table()
    assert told["missed_ticks"] == 4, "what the first record missed is not the loop's"
    assert told["held_by"] == {WAKE_UP: 1, TICK: 1, BETWEEN: 1}
    longest = told["longest"][0]
    assert (longest["round"], longest["tick"], longest["missed_ticks"], longest["held_by"]) == (3, 3, 2, WAKE_UP)
    both = Overruns(PERIOD_NS)
    both.merge(found)
    both.merge(found)
    assert (both.count, both.missed_ticks) == (6, 8)


def test_ratios_are_those_of_the_rounds():
    ours, theirs = Distribution(), Distribution()
    for factor in (1, 2, 6):
        ours.add_round(times_of(factor * 30_000))
        theirs.add_round(times_of(20_000))
    assert ratios(ours, theirs)["p99"] == {
        "low_quartile": 2.25, "median": 3.0, "high_quartile": 6.0, "together": 9.0,
    }  # fmt: skip


def test_what_the_kernel_does_not_count_stays_unknown(tmp_path):
    folder = tmp_path / "proc/7"
    folder.mkdir(parents=True)
    assert usage_of(7, Facts(tmp_path)) == Usage(None, None, None, None, None, None)
    (folder / "status").write_text("Name:\tx\nVmRSS:\t  1200 kB\nvoluntary_ctxt_switches:\t5\n")
    (folder / "stat").write_text("7 (a (b) c) R 1 1 1 0 -1 4194304 98 0 3 0 0 0")
    known = usage_of(7, Facts(tmp_path))
    assert known == Usage(1200, None, 98, 3, 5, None)
    told = process_table([(known, Usage(1300, None, 99, 3, 9, 4)), (known, known)])
    assert told["growth_kib"] == 100
    assert told["minor_faults"] == 1
    assert told["involuntary_switches"] is None
    assert told["locked_kib"] is None


def test_load_runs_as_declared_and_ends(tmp_path):
    with Load("all", tmp_path, loop_core=0) as running:
        declared = running.declared()
        assert declared["what"] == KINDS["all"].what
        assert declared["processes"] == 2 * len(declared["cores"]) + 1
        end_s = time.monotonic() + 20.0
        while running.declared()["used_s"] <= declared["used_s"] and time.monotonic() < end_s:
            time.sleep(0.02)
        assert running.declared()["used_s"] > declared["used_s"], "it works"
        running.check()
        running._processes[0].kill()
        running._processes[0].wait()
        with pytest.raises(LoadError, match="has ended"):
            running.check()
        pids = [p.pid for p in running._processes]
    assert not list(tmp_path.iterdir()), "what was written is gone"
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


def box(tick, *causes):
    """What is used of a black box."""
    return {"tick": tick, "text": f"tick {tick} woke late", "remedy": "a core of its own", "causes": list(causes)}


def test_black_boxes_are_counted_by_their_strongest_cause():
    first, second = Boxes(), Boxes()
    first.take([box(7, "stolen", "interrupts"), box(90)], 1)
    second.take([box(8, "stolen")] * 100, 2)
    second.left_out = 3
    first.merge(second)
    told = first.as_table()
    assert told["causes"] == {"stolen": 101, UNEXPLAINED: 1}
    assert told["left_out"] == 3
    assert [(t["round"], t["tick"]) for t in told["told"][:3]] == [(1, 7), (1, 90), (2, 8)]
    assert len(told["told"]) == KEPT_BOXES


class Dead:
    """A loop whose records come no more."""

    def __init__(self, record):
        self.record = record

    def wait(self, _until, _timeout_s):
        return self.record

    def command(self, *_):
        return 0


def test_a_simulated_robot_homes_and_moves_until_the_time_is_over(homed):
    rig = homed
    rig.do(Verb.DISABLE)
    operator = LockstepOperator(rig.lockstep, Recorder())
    start_ns = rig.last["time_ns"]
    operation.operate(operator, rig.settings, 12.0, moving=True)
    rows = rig.rows
    assert 12.0 <= (rig.last["time_ns"] - start_ns) * 1e-9 < 12.2
    verbs = {int(v) for v in rows["command_verb"] if v}
    assert {Verb.ENABLE, Verb.MOVE_CP} <= verbs
    assert np.ptp(rows["pose_measured"][:, 0]) > 5.0, "it moves by millimetres"


def test_hardware_stays_without_power(homed):
    homed.do(Verb.DISABLE)
    homed.run(1)
    first = len(homed.rows)
    operation.operate(LockstepOperator(homed.lockstep, Recorder()), homed.settings, 2.0, moving=False)
    assert not homed.rows[first:]["powered"].any()
    assert not homed.rows[first:]["command_verb"].any()


def test_a_loop_that_stands_still_is_an_error(homed):
    with pytest.raises(RunError, match="no record"):
        operation.operate(Dead(None), homed.settings, 1.0, moving=False)
    with pytest.raises(RunError, match="stood still"):
        operation.operate(Dead(homed.last), homed.settings, 1.0, moving=False)


@pytest.fixture
def measuring(monkeypatch, tmp_path):
    """Certifying with rounds that take no time; `tell` what happens in the round of that number."""
    happens: dict[int, type[BaseException]] = {}

    def loop_round(_settings, _seconds, moving, number):
        assert moving, "the plant is a simulation"
        if number in happens:
            raise happens[number]()
        overruns = Overruns(PERIOD_NS, number)
        overruns.see(rows_of((1, 0, 12_000, 3_000), (3, number - 1, 15_000, 4_000)))
        usage = Usage(1000, 900, 5, 0, 10, 0)
        boxes = Boxes()
        boxes.take([box(number)], number)
        return LoopRound(times_of(12_000, 15_000), times_of(3_000, 4_000), overruns, boxes, (usage, usage), Grade.RT, 0)

    monkeypatch.setattr(rounds, "loop_round", loop_round)
    monkeypatch.setattr(cyclictest, "obstacle", lambda _: "")
    monkeypatch.setattr(cyclictest, "measure", lambda *_: times_of(11_000, 14_000))
    monkeypatch.setattr(certify, "examine", lambda _: Diagnosis(0, (unknown("it", "closed"),), Grade.RT))
    monkeypatch.setattr(certify, "warm_up_apart", lambda _: None)
    settings = load("planar-sim", [f'log.directory="{tmp_path}"'])
    return lambda count, tell=None: certify.certify(settings, Plan(60.0, count, "idle"), tell or (lambda _: None)), happens, settings  # fmt: skip


def test_promises_that_are_kept_and_one_that_is_not(measuring):
    run, _, settings = measuring
    steps = []
    document = run(1, steps.append)
    assert document["verdict"] == KEPT
    assert [(s.what, s.done_s, s.total_s) for s in steps] == [("loop", 0.0, 120.0), ("cyclictest", 60.0, 120.0)]
    broken = run(2)
    assert broken["verdict"] == BROKEN
    assert [v["name"] for v in broken["verdicts"] if v["kept"] is False] == ["missed ticks"]
    assert certificate.read(certificate.write(broken, certificate.folder_of(settings))) == broken
    assert certificate.misfits(broken, settings) == []


def test_without_a_reference_nothing_is_proven(measuring, monkeypatch):
    monkeypatch.setattr(cyclictest, "obstacle", lambda _: "no cyclictest on this machine")
    document = measuring[0](1)
    assert document["ratios"] is None
    assert document["verdict"] == UNPROVEN
    assert "no cyclictest on this machine" in read(page(document)).text


def test_ctrl_c_leaves_what_was_measured_or_nothing(measuring, capsys):
    run, happens, settings = measuring
    happens[2] = KeyboardInterrupt
    document = run(4)
    assert (document["complete"], document["rounds"], document["rounds_asked"]) == (False, 1, 4)
    assert document["verdict"] == UNPROVEN
    assert document["lateness"]["count"] == 2
    assert "interrupted. It proves nothing" in read(page(document)).text
    words = ["certify", "planar-sim", "--minutes", "1", "--rounds", "4", "--set", f'log.directory="{settings.log.directory}"']  # fmt: skip
    assert main(words) == Exit.INTERRUPTED
    assert "interrupted after 1 of 4 rounds" in capsys.readouterr().err
    assert certificate.newest(settings) is None, "no log names it"
    happens[1] = KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt):
        run(4)


def test_a_run_that_fails_leaves_no_certificate(measuring):
    run, happens, settings = measuring
    happens[3] = lambda: RunError("the daemon failed")
    with pytest.raises(RunError):
        run(4)
    assert not list(certificate.folder_of(settings).iterdir())


def test_a_plan_that_means_nothing_is_refused():
    with pytest.raises(RtctlError, match="too short"):
        Plan(10.0, 15, "idle")
    assert main(["certify", "planar-sim", "--load", "much"]) == Exit.BAD_INPUT


class Reader(HTMLParser):
    """Balanced tags, no references, and the text."""

    def __init__(self):
        super().__init__()
        self.open, self.text, self.svgs = [], "", 0

    def handle_starttag(self, tag, attrs):
        assert not any(k in ("src", "href", "xlink:href") and not v.startswith("#") for k, v in attrs)
        self.svgs += tag == "svg"
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def read(html) -> Reader:
    reader = Reader()
    reader.feed(html)
    assert reader.open == []
    return reader


def test_the_page_is_whole_and_says_what_the_document_says(measuring):
    document = measuring[0](3)
    told = read(page(document))
    assert told.svgs == 3
    assert document["sha256"] in told.text
    assert "promises not kept" in told.text
    assert "2 times grid points were missed, 3 in all" in told.text
    assert "could not be read: closed" in told.text
    assert "tick 3 woke late" in told.text
