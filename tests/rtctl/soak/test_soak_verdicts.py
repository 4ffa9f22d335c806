"""Each promise of a soak is broken by what breaks it, and by nothing else."""

import os
from dataclasses import replace

import numpy as np
import pytest

from rtctl.log.format import CONTROLLER, PARAMETERS, PLANS
from rtctl.log.reader import Log
from rtctl.log.writer import LogWriter
from rtctl.record import controller_table
from rtctl.replaying.difference import Difference
from rtctl.soak import recorded as logs
from rtctl.soak.processes import MODULES, Sample, children, sample
from rtctl.soak.recorded import Recorded
from rtctl.soak.run import Noted, Outage
from rtctl.soak.verdicts import verdicts

KILL = Outage(10_000_000_000, 13_000_000_000)
TIMES = {"tick_ns": np.full(1000, 5000), "lateness_ns": np.full(1000, 20_000)}


def samples(**growing):
    """A hundred samples of every process; `growing` names a quantity of the real-time process that grows."""
    made = []
    for role in MODULES:
        for k in range(100):
            one = Sample(float(k), role, 7, 100_000, 17_000, 9, 20)
            made.append(replace(one, **{n: getattr(one, n) + k * by for n, by in growing.items()}) if role == "real-time" else one)  # fmt: skip
    return made


def good():
    storm = {"sent": 100, "answered": 98, "doubled": 0, "unanswered_ns": [(9_990_000_000, 10_100_000_000)] * 2}
    noted = Noted(
        1, 60.0, [KILL], samples(), [(0.0, 0), (60.0, 12_000_000)], [storm], {"home: accepted": 3, "home: busy": 2}
    )
    noted.gateways = {1, 2}
    rows = Recorded(
        2, 60_000, 60_000, 4, cut_short=1, last_is_whole=True, ends_safely=True, replayed=60_000, row_bytes=900
    )
    rows.during, rows.outside = dict(TIMES), dict(TIMES)
    return noted, rows


def broken(noted, rows, exit_code=0):
    return [v.name for v in verdicts(noted, rows, exit_code) if not v.good]


def test_a_good_run_keeps_all():
    assert broken(*good()) == []


@pytest.mark.parametrize(
    ("changes", "promise"),
    [
        ({"missing": 3, "rows": 59_997, "replayed": 59_997}, "no record is lost uncounted"),
        ({"rows": 0, "ticks": 0, "replayed": 0}, "no record is lost uncounted"),
        ({"cut_short": 2}, "every log is whole"),
        ({"last_is_whole": False}, "every log is whole"),
        ({"difference": Difference(1, "depth_mm", 0.0, 1.0)}, "the replay is identical to the bit"),
        ({"replay_error": "records are missing"}, "the replay is identical to the bit"),
        ({"replayed": 100}, "the replay is identical to the bit"),
        ({"ends_safely": False}, "nothing else dies, and it ends safely"),
        ({"during": {**TIMES, "tick_ns": TIMES["tick_ns"] * 3}}, "no tick waits for the gateway"),
        ({"during": {**TIMES, "lateness_ns": TIMES["lateness_ns"] * 3}}, "no tick is late for it"),
    ],
)
def test_what_the_logs_tell(changes, promise):
    noted, rows = good()
    assert promise in broken(noted, replace(rows, **changes))


def test_counted_losses_are_no_broken_promise():
    noted, rows = good()
    noted.status = {"lost_records": 7}
    lossy = replace(rows, rows=59_993, missing=7, replayed=100, replay_ended_by_gap=True)
    assert broken(noted, lossy) == []
    skipping = replace(lossy, rows=59_990, missing=10)  # three of these grid points were skipped
    assert "no record is lost uncounted" in broken(noted, skipping)
    noted.status["missed_ticks"] = rows.missed + 3
    assert broken(noted, skipping) == []


@pytest.mark.parametrize(
    ("change", "promise"),
    [
        (lambda n: n.storms[0]["unanswered_ns"].append((40_000_000_000, 45_000_000_000)), "every request is answered once"),
        (lambda n: n.storms[0].update(answered=97), "every request is answered once"),
        (lambda n: n.storms[0].update(doubled=1), "every request is answered once"),
        (lambda n: n.storms[0].clear(), "every request is answered once"),
        (lambda n: n.operator_unanswered_ns.append((1, 2)), "every request is answered once"),
        (lambda n: n.outcomes.clear(), "commands are obeyed and refused"),
        (lambda n: n.gateways.add(3), "nothing else dies, and it ends safely"),
        (lambda n: n.disk.__setitem__(1, (60.0, 10**9)), "the disk fills as expected"),
        (lambda n: n.disk.__setitem__(1, (60.0, 0)), "the disk fills as expected"),
    ],
)  # fmt: skip
def test_what_was_seen_from_outside(change, promise):
    noted, rows = good()
    change(noted)
    assert broken(noted, rows) == [promise]


@pytest.mark.parametrize("quantity", ["resident_kib", "shared_kib", "threads", "descriptors"])
def test_a_process_that_grows_is_seen(quantity):
    noted, rows = good()
    noted.samples = samples(**{quantity: 2})
    assert broken(noted, rows) == ["the real-time does not grow"]
    noted.samples = []
    assert len(broken(noted, rows)) == len(MODULES)


def test_a_bad_end_is_told():
    assert broken(*good(), exit_code=5) == ["nothing else dies, and it ends safely"]


def in_two_files(insertion, folder, first, second):
    """The run of `insertion` as a restarted gateway would have logged it: rows up to `first`, and those from `second` on."""
    log, paths = Log.open(insertion.log), [folder / "log.mcap", folder / "log-2.mcap"]
    for path, rows in zip(paths, (log.controller[:first], log.controller[second:]), strict=True):
        with LogWriter(path, {CONTROLLER: controller_table(3)}, log.header) as writer:
            if path == paths[0]:
                for topic in (PARAMETERS, PLANS):
                    for message in log.messages[topic]:
                        writer.write_json(topic, message.time_ns, message.payload)
            writer.write_rows(CONTROLLER, rows)
    return paths, len(log.controller)


def test_logs_are_read_file_by_file_and_replayed_over_their_ends(insertion, tmp_path):
    paths, ticks = in_two_files(insertion, tmp_path, 8000, 7500)
    found = logs.read(paths, [Outage(7_900_000_000, 8_100_000_000)])
    assert (found.rows, found.ticks, found.missing, found.replayed) == (ticks, ticks, 0, ticks)
    assert (found.difference, found.replay_error) == (None, "")
    assert (len(found.during["tick_ns"]), len(found.outside["tick_ns"])) == (201, ticks - 201)
    assert (found.cut_short, found.last_is_whole, found.ends_safely) == (0, True, True)


def test_a_gap_between_files_is_counted_and_ends_the_replay(insertion, tmp_path):
    paths, ticks = in_two_files(insertion, tmp_path, 8000, 8017)
    found = logs.read(paths, [])
    assert (found.rows, found.ticks, found.missing) == (ticks - 17, ticks, 17)
    assert (found.replayed, found.replay_ended_by_gap) == (8000, True)
    assert logs._lost("17 rows of /controller were overwritten before they were logged") == 17
    assert logs._lost("the run is over") == 0


def test_a_process_is_looked_at_from_outside():
    me = sample("test", os.getpid())
    assert me is not None
    assert me.resident_kib > 10_000
    assert me.threads >= 1
    assert me.descriptors >= 3
    assert sample("nobody", 2**22 + 1) is None
    assert children(os.getpid()) == {"supervisor": os.getpid()}
