"""The gateway as a process: log, lease and health, parameters, plans, and every way it can end."""

import base64
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from rtctl import plan_file
from rtctl.client import NoReply
from rtctl.commands import CommandRefused, Verb
from rtctl.electrode.path import PATH
from rtctl.exchange.control import LOG_WRITING, OPERATOR_EXPECTED, OPERATOR_PRESENT, RealTimeState, Word, get
from rtctl.exchange.ring import committed
from rtctl.gateway import journal
from rtctl.gateway.process import EXIT_REAL_TIME_DIED
from rtctl.lifecycle import Operating
from rtctl.log.format import LogError
from rtctl.log.reader import Log, open_many
from rtctl.memory import parameters_dtype
from rtctl.parameters import pack
from rtctl.planner import make_plan, plan_of


def eventually(condition, timeout_s=5.0):
    until = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < until, "it did not happen"
        time.sleep(0.005)


def word(world, which):
    return int(get(world.segment.control, which))


def wait_for_gateway(world, process=None):
    """A client, as soon as there is somebody to talk to."""
    for _ in range(100):
        try:
            client = world.client(timeout_s=4.0)
            client.wait(lambda _: True, 4.0, "the first record")
            return client
        except NoReply:
            assert process is None or process.poll() is None, process.communicate()
            time.sleep(0.1)
    raise AssertionError("no gateway")


def test_every_record_and_every_truth_is_logged_and_the_header_tells_the_experiment(world):
    client = world.client()
    client.command(Verb.ENABLE)
    world.real_time.stop()
    assert world.join() == 0
    log = Log.open(world.directory / "log.mcap")
    assert log.complete
    assert log.missing_ticks() == []
    assert len(log.controller) == committed(world.segment.records) == len(log.truth)
    assert log.controller["tick"][0] == int(log.header["first_tick"]) == 0
    assert log.header["seed"] == "7"
    assert log.header["robot"] == "planar"
    assert log.header["grade"] == "sim"
    assert all(log.header[name] for name in ("settings", "config_hash", "kernel_hash", "python", "package.numpy"))
    texts = [e["text"] for e in log.events]
    assert "enable accepted" in texts
    assert texts[-1] == "the run is over"
    assert word(world, Word.LOST_RECORDS) == 0
    assert word(world, Word.RECORD_POSITION) == committed(world.segment.records)


def test_the_parameter_set_of_the_start_is_in_the_log_bit_for_bit(world):
    world.client().wait(lambda _: True, 2.0)
    world.real_time.stop()
    world.join()
    (first,) = Log.open(world.directory / "log.mcap").parameters
    expected = pack(world.settings, world.robot, 1)
    assert first["number"] == 1
    assert base64.b64decode(first["record_base64"]) == expected.tobytes()


def test_parameters_are_checked_as_a_set_logged_and_taken_over(world):
    client = world.client()
    number = client.set_parameters({"admittance.blend_end_mm": 9.0, "safety.force_limit_n": 0.7}).result["number"]
    assert number == 2
    assert client.parameters("safety.force_limit_n", "admittance.blend_end_mm") == {
        "safety.force_limit_n": 0.7,
        "admittance.blend_end_mm": 9.0,
    }
    taken = world.real_time.parameters[0]
    assert (taken["number"], taken["force_limit_n"], taken["blend_end_mm"]) == (2, 0.7, 9.0)
    assert client.set_parameters({"safety.force_limit_n": 0.8}).result["number"] == 3
    assert world.real_time.parameters[0]["blend_end_mm"] == 9.0
    world.real_time.stop()
    world.join()
    log = Log.open(world.directory / "log.mcap")
    assert [p["number"] for p in log.parameters] == [1, 2, 3]
    logged = np.frombuffer(base64.b64decode(log.parameters[1]["record_base64"]), parameters_dtype(3))
    assert logged["force_limit_n"] == [0.7]
    positions = [m.time_ns for m in log.messages["/parameters"]]
    effect = log.controller["time_ns"][np.argmax(log.controller["parameter_set"] == 2)]
    assert positions[1] <= effect


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"loop.period_s": 0.002}, "not_live"),
        ({"robot": {}}, "unknown_parameter"),
        ({"safety.force_limit": 0.7}, "unknown_parameter"),
        ({"safety.force_limit_n": 70.0}, "invalid_setting"),
        ({"safety.force_limit_n": "much"}, "invalid_setting"),
        ({"control.backlash_rad": [1.0]}, "invalid_setting"),
        ({"safety.force_limit_n": 0.7, "admittance.blend_end_mm": 1.0}, "invalid_setting"),
        ({}, "malformed"),
    ],
)
def test_a_set_with_anything_wrong_in_it_changes_nothing(world, values, reason):
    client = world.client()
    before = client.parameters()
    with pytest.raises(CommandRefused) as refused:
        client.set_parameters(values)
    assert refused.value.reason == reason
    assert client.parameters() == before
    assert all(c["verb"] != Verb.SET_PARAMETERS for c in world.real_time.commands)


def test_the_reference_of_the_options_tells_which_are_live_and_no_secret(make_world):
    made = make_world({"gateway": {"user": "a", "password": "secret"}})
    made.real_time.start()
    made.serve()
    reference = made.client(user="a", password="secret").parameter_reference()
    assert reference["safety.force_limit_n"] == {
        "value": 0.5,
        "unit": "N",
        "bound": "0.05 .. 5 N",
        "live": True,
        "doc": reference["safety.force_limit_n"]["doc"],
    }
    assert not reference["loop.period_s"]["live"]
    assert "secret" not in str(reference)


def test_a_plan_needs_an_entry_and_is_computed_beside_the_heartbeat(world):
    client = world.client()
    client.command(Verb.ENABLE)
    with pytest.raises(CommandRefused) as refused:
        client.plan()
    assert refused.value.reason == "not_registered"
    client.command(Verb.REGISTER_ENTRY)
    reply = client.plan()
    assert reply.result["number"] == 1
    expected = make_plan(world.settings, world.robot, world.settings.workflow.entry_pose_mm_rad, 1)
    assert world.real_time.plan.tobytes() == expected.tobytes()
    assert client.plan().result["number"] == 2
    world.real_time.stop()
    world.join()
    log = Log.open(world.directory / "log.mcap")
    assert [p["number"] for p in log.plans] == [1, 2]
    assert np.frombuffer(base64.b64decode(log.plans[0]["record_base64"]), PATH).tobytes() == expected.tobytes()


def test_a_plan_of_a_file_is_placed_at_the_registered_entry_or_refused(world):
    client = world.client()
    client.command(Verb.ENABLE)
    plan, entry = plan_of(world.settings), np.array(world.settings.workflow.entry_pose_mm_rad)
    content = plan_file.document(plan_file.describe(world.settings, plan, entry + 0.01))
    with pytest.raises(CommandRefused) as refused:
        client.plan(content)
    assert refused.value.reason == "not_registered"
    client.command(Verb.REGISTER_ENTRY)
    assert client.plan(content).result["number"] == 1
    assert world.real_time.plan.tobytes() == make_plan(world.settings, world.robot, entry, 1).tobytes()
    for wrong in (content | {"version": 2}, content | {"cochlea": {"spiral_a_mm": 4.0, "side": "right"}}, {}):
        with pytest.raises(CommandRefused) as refused:
            client.plan(wrong)
        assert refused.value.reason == "plan_refused"
        assert "rtctl plan make" in refused.value.remedy
    assert world.real_time.plan[0]["number"] == 1
    assert client.plan().result["number"] == 2  # planning is free again


def test_stop_works_while_a_plan_is_computed_and_a_second_plan_has_to_wait(world):
    client = world.client("first")
    client.command(Verb.ENABLE)
    client.command(Verb.REGISTER_ENTRY)
    numbers = []
    planning = threading.Thread(target=lambda: numbers.append(client.plan().result["number"]))
    planning.start()
    other = world.client("second")
    eventually(lambda: other.status()["planning"] or numbers)
    assert other.stop().tick is not None
    planning.join()
    assert numbers == [1]


def test_the_operator_is_expected_while_the_lease_is_held_and_missed_when_it_dies_in_motion(world):
    world.real_time.busy_ticks = 100_000
    client = world.client("surgeon")
    client.command(Verb.ENABLE)
    both = OPERATOR_EXPECTED | OPERATOR_PRESENT
    eventually(lambda: word(world, Word.GATEWAY_HEALTH) == LOG_WRITING | both)
    client.command(Verb.MOVE_CP, 160.0, 0.0, 0.0)
    client.wait(lambda r: r["is_busy"], 2.0)
    client._closing.set()  # the renewing thread falls silent, as in a client that hangs
    watcher = world.client("watcher")
    row = watcher.wait(lambda r: r["operating_state"] == Operating.PAUSED, 3.0, "the pause")
    assert row["gateway_health"] & both == OPERATOR_EXPECTED
    assert watcher.status()["lease_holder"] is None
    watcher.acquire()
    watcher.command(Verb.RESUME)
    client._closing.clear()


def test_after_a_release_nobody_is_missed(world):
    world.real_time.busy_ticks = 100_000
    with world.client() as client:
        client.command(Verb.ENABLE)
        client.command(Verb.MOVE_CP, 160.0, 0.0, 0.0)
    eventually(lambda: word(world, Word.GATEWAY_HEALTH) == LOG_WRITING)
    watcher = world.client("watcher")
    tick = watcher.wait(lambda r: r["is_busy"], 2.0)["tick"]
    assert watcher.wait(lambda r: r["tick"] > tick + 700, 3.0)["operating_state"] == Operating.ENABLED


class FullDisk:
    """A log writer whose disk fills up after some rows."""

    def __init__(self, path, *_args, **_options):
        path.write_bytes(b"")
        self.room = 200

    def write_rows(self, _topic, rows):
        self.room -= len(rows)
        if self.room < 0:
            raise LogError("the log cannot be written any more", value="No space left on device")

    def write_json(self, *_args):
        pass

    def flush(self):
        pass

    def close(self):
        pass


def test_a_full_disk_pauses_the_motion_and_the_gateway_goes_on(make_world, monkeypatch):
    monkeypatch.setattr(journal, "LogWriter", FullDisk)
    world = make_world()
    world.serve()
    client = world.client()
    events = []
    client.on_event(events.append)
    world.real_time.start()
    client.command(Verb.ENABLE)
    row = client.wait(lambda r: r["operating_state"] == Operating.PAUSED, 3.0, "the pause")
    assert not row["gateway_health"] & LOG_WRITING
    assert "No space left" in client.status()["log_failure"]
    eventually(lambda: any(e["kind"] == "log" and e["severity"] == "error" for e in events))
    with pytest.raises(CommandRefused) as refused:
        client.set_parameters({"safety.force_limit_n": 0.7})
    assert refused.value.reason == "log_failed"
    assert client.stop().tick is not None


def test_overwritten_records_are_counted_and_told(make_world):
    world = make_world({"log": {"ring_rows": 1024}})
    for tick in range(3000):
        world.real_time.run_tick(tick)
    world.serve()
    world.real_time.start()
    client = world.client()
    client.wait(lambda _: True, 2.0)
    lost = client.status()["lost_records"]
    world.real_time.stop()
    world.join()
    log = Log.open(world.directory / "log.mcap")
    assert lost == log.controller["tick"][0] >= 3000 - 1024  # the loop may write another row before the first is read
    assert any(e["kind"] == "records" and f"{lost} rows of /controller" in e["text"] for e in log.events)


def test_a_killed_gateway_is_replaced_without_loss(make_world):
    world = make_world({"log": {"ring_rows": 65536}})  # room for a gateway that has to compile first
    world.real_time.start()
    first = world.spawn()
    client = wait_for_gateway(world, first)
    assert client.command(Verb.ENABLE).tick is not None
    client.set_parameters({"safety.force_limit_n": 0.7})
    eventually(lambda: word(world, Word.RECORD_POSITION) > 0)
    first.kill()
    first.wait()
    begin = time.monotonic()
    client.close()
    assert time.monotonic() - begin < 5.0
    second = world.spawn()
    client = wait_for_gateway(world, second)
    assert client.parameters("safety.force_limit_n") == {"safety.force_limit_n": 0.7}
    assert client.set_parameters({"admittance.deadband_n": 0.05}).result["number"] == 3
    client.command(Verb.PAUSE)
    sequences = [int(c["sequence"]) for c in world.real_time.commands]
    assert sequences == sorted(set(sequences))
    world.real_time.stop()
    assert second.wait(10.0) == 0
    log = open_many([world.directory / "log.mcap", world.directory / "log-2.mcap"])
    ticks = log.controller["tick"]
    assert log.missing_ticks() == []
    assert ticks[0] == 0
    assert ticks[-1] == world.real_time.tick
    assert np.all(np.diff(ticks) == 1)
    assert word(world, Word.LOST_RECORDS) == 0


def test_sigterm_ends_it_with_a_whole_log(make_world):
    world = make_world()
    world.real_time.start()
    process = world.spawn()
    client = wait_for_gateway(world, process)
    client.command(Verb.ENABLE)
    process.send_signal(signal.SIGTERM)
    assert process.wait(10.0) == 0
    log = Log.open(world.directory / "log.mcap")
    assert log.complete
    assert log.events[-1]["text"] == "the gateway was asked to end"


@pytest.mark.parametrize("state", [RealTimeState.RUNNING, RealTimeState.STOPPED])
def test_the_death_of_the_real_time_process_is_noticed(make_world, state):
    world = make_world()
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        world.real_time.start(pid=other.pid)
        world.serve()
        world.client().wait(lambda _: True, 2.0)
        world.real_time.stop(state)
        other.kill()  # not waited for: a zombie counts as dead
        code = world.join()
    last = Log.open(world.directory / "log.mcap").events[-1]["text"]
    if state is RealTimeState.RUNNING:
        assert code == EXIT_REAL_TIME_DIED
        assert "watchdog removes power" in last
    else:
        assert code == 0
        assert last == "the run is over"


def test_a_taken_port_is_a_clear_error(world, make_world):
    other = make_world({"gateway": {"endpoint": world.endpoint}})
    process = other.spawn()
    _, errors = process.communicate(timeout=20.0)
    assert process.returncode == 1
    assert "cannot listen" in errors
    assert world.endpoint in errors
