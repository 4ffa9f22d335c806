"""The client against a gateway and a double of the real-time process."""

import threading
import time

import pytest

from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.client import Client, NoReply, RecordsStopped, WaitedTooLong
from rtctl.commands import CommandRefused, Verb
from rtctl.lifecycle import Condition, Operating
from rtctl.log.reader import Log


def test_a_command_takes_effect_and_its_tick_comes_back(world):
    client = world.client()
    reply = client.command(Verb.ENABLE)
    assert 0 <= reply.tick <= world.real_time.tick
    row = client.wait(lambda r: r["operating_state"] == 1, timeout_s=2.0)
    assert row["tick"] >= reply.tick


def test_a_refusal_says_why_and_what_to_do(world):
    client = world.client()
    with pytest.raises(CommandRefused) as refused:
        client.command(Verb.MOVE_CP, 160.0, 0.0, 0.0)
    assert refused.value.reason == "wrong_state"
    assert "enable" in refused.value.remedy


def test_a_refusal_in_fault_carries_the_ticks_before_the_fault(world, capsys):
    client, faults = world.client(), []
    client.on_event(lambda event: faults.append(event) if "state is fault" in event["text"] else None)
    client.command(Verb.ENABLE)
    client.wait(lambda r: r["tick"] > 60, timeout_s=2.0)
    with pytest.raises(CommandRefused) as none_yet:
        client.blackbox()
    assert none_yet.value.reason == "no_black_box"
    world.real_time.extra_conditions = 1 << Condition.AMPLIFIER
    client.wait(lambda r: r["operating_state"] == Operating.FAULT, timeout_s=2.0)
    with pytest.raises(CommandRefused) as refused:
        client.command(Verb.MOVE_CP, 160.0, 0.0, 0.0)
    box = refused.value.blackbox
    tick, states = box["tick"], dict(zip(box["signals"]["tick"], box["signals"]["operating_state"], strict=True))
    assert (states[tick - 1], states[tick]) == (Operating.ENABLED, Operating.FAULT)
    assert box["text"].startswith("state is fault")
    client.wait(lambda r: r["tick"] > tick + 80, timeout_s=2.0)
    assert client.blackbox(tick)["rows"]["tick"][0] == tick - 50
    (event,) = faults
    assert event["blackbox"] == event["last"]["tick"][-1] == tick
    assert event["last"]["condition_active"][-1] == 1 << Condition.AMPLIFIER
    world.real_time.stop()
    world.join()
    assert [b["tick"] for b in Log.open(world.directory / "log.mcap").blackboxes] == [tick]
    assert main(["log", "blackbox", str(world.directory), "--around", "2"]) == Exit.OK
    told = capsys.readouterr().out
    assert told.startswith("fault: state is fault (was enabled)")
    assert sum(line.split()[0].isdecimal() for line in told.splitlines() if line.strip()) == 5
    assert main(["log", "blackbox", str(world.directory), "--tick", "3"]) == Exit.DATA
    assert str(tick) in capsys.readouterr().err, "the ticks that have one are listed"


@pytest.mark.parametrize(("verb", "arguments"), [(Verb.MOVE_CP, (1.0,)), (Verb.INSERT, ()), (Verb.ENABLE, (1.0,))])
def test_the_number_of_arguments_is_checked(world, verb, arguments):
    with pytest.raises(CommandRefused) as refused:
        world.client().command(verb, *arguments)
    assert refused.value.reason == "wrong_arguments"
    assert refused.value.value == len(arguments)
    assert world.real_time.commands == []


def test_staged_verbs_are_not_for_clients(world):
    client = world.client()
    for verb in (Verb.NONE, Verb.LOAD_PLAN, Verb.SET_PARAMETERS):
        with pytest.raises(ValueError, match="not for clients"):
            client.command(verb)


def test_numbers_and_source_arrive_as_they_were_sent(world):
    client = world.client()
    client.command(Verb.ENABLE)
    client.command(Verb.MOVE_CP, 160.25, -3.5, 0.125)
    command = world.real_time.commands[-1]
    assert command["verb"] == Verb.MOVE_CP
    assert command["argument"].tolist() == [160.25, -3.5, 0.125, 0, 0, 0, 0, 0]
    assert command["source"] == world.real_time.commands[0]["source"] != 0
    assert command["sequence"] == world.real_time.commands[0]["sequence"] + 1


def test_a_second_client_reads_and_stops_but_does_not_write(world):
    first, second = world.client("first"), world.client("second")
    first.command(Verb.ENABLE)
    first.command(Verb.MOVE_CP, 160.0, 0.0, 0.0)
    with pytest.raises(CommandRefused, match="first holds the lease") as refused:
        second.command(Verb.MOVE_CP, 150.0, 0.0, 0.0)
    assert refused.value.reason == "lease_taken"
    assert second.status()["lease_holder"] == "first"
    assert second.wait(lambda r: r["operating_state"] == 1, 2.0)["is_busy"] in (0, 1)
    assert second.stop().tick is not None
    assert world.real_time.commands[-1]["verb"] == Verb.STOP


def test_a_released_lease_is_free_at_once(world):
    with world.client("first") as first:
        first.command(Verb.ENABLE)
    second = world.client("second")
    second.command(Verb.DISABLE)
    assert second.status()["lease_holder"] == "second"


def test_the_lease_outlives_silence_of_the_user_because_it_is_renewed(world):
    first, second = world.client("first"), world.client("second")
    first.command(Verb.ENABLE)
    time.sleep(3 * world.settings.gateway.lease_s)
    with pytest.raises(CommandRefused, match="first holds"):
        second.command(Verb.DISABLE)


def test_wait_returns_the_record_or_says_what_did_not_happen(world):
    client = world.client()
    tick = client.wait(lambda r: r["tick"] > 5, 2.0)["tick"]
    assert client.latest()["tick"] >= tick
    with pytest.raises(WaitedTooLong, match="the moon did not happen"):
        client.wait(lambda _: False, 0.05, "the moon")


def test_a_controller_that_falls_silent_ends_the_wait_at_once(world, monkeypatch):
    monkeypatch.setattr("rtctl.client.SILENCE_S", 0.3)
    client = world.client()
    client.wait(lambda r: r["tick"] > 5, 2.0)
    world.real_time.stop()
    with pytest.raises(RecordsStopped, match="fell silent while waiting for the moon"):
        client.wait(lambda _: False, 60.0, "the moon")


def test_events_reach_the_client(world):
    client = world.client()
    seen, arrived = [], threading.Event()

    def note(event):
        seen.append(event)
        if event["text"].startswith("state is enabled"):
            arrived.set()

    client.on_event(note)
    client.command(Verb.ENABLE)
    assert arrived.wait(2.0)
    assert {"kind": "command", "text": "enable accepted"}.items() <= next(
        e for e in seen if e["kind"] == "command"
    ).items()


def test_feedback_carries_the_numbers_of_the_record(world):
    world.real_time.row[0]["pose_measured"] = [1.0, 2.0, float("nan")]
    client = world.client()
    seen, arrived = [], threading.Event()
    client.subscribe("measured_cp", lambda m: (seen.append(m), m["values"] == [1.0, 2.0, None] and arrived.set()))
    assert arrived.wait(2.0)
    assert "mm" in seen[-1]["unit"]


def test_nobody_listens(make_world):
    endpoint = make_world().endpoint
    begin = time.monotonic()
    with pytest.raises(NoReply, match="nobody answers"):
        Client(endpoint=endpoint)
    assert time.monotonic() - begin < 5.0


def test_no_reply_says_whether_the_controller_is_alive(world):
    other = Client("nobody", world.endpoint, timeout_s=0.5)
    world.clients.append(other)
    assert not other.is_alive()
    with pytest.raises(NoReply, match="no controller of 'nobody' is alive"):
        other.status()
    assert world.client().is_alive()


def test_a_loop_that_does_not_answer_gives_a_clear_reply(world):
    client = world.client(timeout_s=4.0)
    client.acquire()
    world.real_time.mute = True
    with pytest.raises(CommandRefused) as refused:
        client.command(Verb.ENABLE)
    assert refused.value.reason == "no_verdict"


def test_closing_never_hangs_even_when_the_gateway_is_gone(make_world):
    world = make_world()
    world.real_time.start()
    world.serve()
    client = world.client()
    client.command(Verb.ENABLE)
    world.gateway.stop()
    assert world.join() == 0
    begin = time.monotonic()
    client.close()
    client.close()
    assert time.monotonic() - begin < 5.0
