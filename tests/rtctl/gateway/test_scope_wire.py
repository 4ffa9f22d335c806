"""A scope over Zenoh: what the client gets is what the log says, to the bit."""

import io
import time

import numpy as np
import pytest

from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.client import NoReply
from rtctl.commands import CommandRefused, Verb
from rtctl.gateway import scopes
from rtctl.log.reader import Log
from rtctl.scope import client as scope_client
from rtctl.scope.client import NoCapture, RemoteScope, ScopeEnded
from rtctl.scope.files import load
from rtctl.scope.setup import Event, Manual

PERIOD = 100


@pytest.fixture
def saw(make_world):
    """A double whose axial force is a saw of so many ticks, from 0 down to -1 N."""
    made = make_world()
    run_tick = made.real_time.run_tick

    def with_force(tick):
        made.real_time.row[0]["force_axial_n"] = -(tick % PERIOD) / PERIOD
        made.real_time.row[0]["wrench_in_base"] = tick
        made.real_time.truth[0]["array_depth_mm"] = tick / 7
        run_tick(tick)

    made.real_time.run_tick = with_force
    made.real_time.start()
    made.serve()
    return made


def test_captures_are_the_rows_of_the_log(saw, monkeypatch):
    monkeypatch.setattr(scopes, "PIECE_BYTES", 1000)
    client = saw.client()
    names = ["force_axial_n", "wrench_in_base", "wrench_in_base[3]", "command_verb", "truth.array_depth_mm"]
    options = {"samples": 60, "pre": 20, "captures": 3}
    with client.scope(names, "force_axial_n < -0.5", edge="falling", **options) as edge:
        with client.scope(["is_busy"], Event("command:enable"), samples=7, pre=3) as event:
            while event.progress.state != "waiting":
                time.sleep(0.01)
            enabled = client.command(Verb.ENABLE).tick
            assert event.wait(2.0).trigger_tick == enabled
        captures = list(edge)
    saw.real_time.stop()
    saw.join()
    log = Log.open(saw.directory / "log.mcap")
    rows, truths = ({int(r["tick"]): r for r in part} for part in (log.controller, log.truth))
    assert [c.number for c in captures] == [0, 1, 2]
    for capture in captures:
        assert capture.trigger_tick % PERIOD == PERIOD // 2
        assert capture["tick"].tolist() == list(range(capture.trigger_tick - 20, capture.trigger_tick + 40))
        mine = [rows[t] for t in capture["tick"].tolist()]
        for name in ("time_ns", "force_axial_n", "wrench_in_base", "command_verb"):
            np.testing.assert_array_equal(capture[name], [r[name] for r in mine])
        np.testing.assert_array_equal(capture["wrench_in_base[3]"], [r["wrench_in_base"][3] for r in mine])
        depth_mm = [truths[t]["array_depth_mm"] for t in capture["tick"].tolist()]
        np.testing.assert_array_equal(capture["truth.array_depth_mm"], depth_mm)
        assert capture.units["truth.array_depth_mm"] == "mm"
        assert capture.lost_records == capture.missed_ticks == 0
    assert len({t for c in captures for t in c["tick"].tolist()}) == 180


def test_forced_stopped_and_refused(saw):
    client = saw.client()
    with client.scope(["depth_mm"], Manual(), samples=30, pre=10, decimation=5) as scope:
        with pytest.raises(NoCapture, match="for a manual trigger"):
            scope.wait(0.3)
        scope.force()
        capture = scope.wait(2.0)
        assert capture.cause == "forced"
        assert set(np.diff(capture["tick"])) == {5}
        with pytest.raises(ScopeEnded, match="all its captures"):
            scope.wait(2.0)
    open_one = client.scope(["depth_mm"], Manual())
    open_one.stop()
    with pytest.raises(ScopeEnded, match="stopped"):
        open_one.wait(1.0)
    with pytest.raises(CommandRefused, match="no such scope"):
        open_one.force()
    with pytest.raises(CommandRefused, match="did you mean depth_mm") as refused:
        client.scope(["depth_m"])
    assert refused.value.reason == "invalid_scope"
    assert len(saw.gateway._run.scopes) == 0


def test_a_gateway_that_is_gone_ends_the_scope_with_a_reason(saw, monkeypatch):
    monkeypatch.setattr(scope_client, "SILENCE_S", 0.3)
    client = saw.client(timeout_s=0.3)
    scope = client.scope(["depth_mm"], Manual())
    saw.gateway.stop()
    saw.join()
    with pytest.raises(ScopeEnded, match="rtctl scope --log") as ended:
        scope.wait(10.0)
    assert ended.value.exit_code == NoReply.exit_code
    scope.stop()


def test_the_command_line_captures_by_hand_and_keeps_what_it_has_when_interrupted(saw, monkeypatch, tmp_path, capsys):
    common = ["--samples", "20", "--pre", "5", "--endpoint", saw.endpoint]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    words = ["scope", "depth_mm", "--manual", "--captures", "2", "--output", str(tmp_path / "a.csv"), *common]
    assert main(words) == Exit.FAILED  # Enter was pressed once
    assert len((tmp_path / "a.csv").read_text().splitlines()) == 21
    told = capsys.readouterr()
    assert "capture 1 of 2: tick" in told.err
    assert "press Enter" in told.err
    assert "depth_mm" in told.out

    wait, calls = RemoteScope.wait, []

    def interrupted(scope, timeout_s=None):
        if scope.progress.finished and calls:
            raise KeyboardInterrupt
        calls.append(capture := wait(scope, timeout_s))
        return capture

    monkeypatch.setattr(RemoteScope, "wait", interrupted)
    words = ["scope", "depth_mm", "--captures", "9", "--output", str(tmp_path / "b.mcap"), *common]
    assert main(words) == Exit.INTERRUPTED
    assert [c.number for c in load(tmp_path / "b.mcap")] == [0]
    assert len(saw.gateway._run.scopes) == 0
    assert main(["scope", "depth_mm", "--fault", "--timeout", "0.2", *common]) == Exit.FAILED
    assert "the scope is waiting, for the event state:fault" in capsys.readouterr().err
