"""Raw queries on the wire: whoever sends whatever gets an answer, and the gateway goes on."""

import json
import random
import time

import pytest
import zenoh

from rtctl.client import Client, NoReply
from rtctl.commands import CommandRefused, Verb
from rtctl.gateway.keys import REQUESTS
from rtctl.gateway.transport import configure


@pytest.fixture
def session(world):
    config = configure("client")
    config.insert_json5("connect/endpoints", json.dumps([world.endpoint]))
    with zenoh.open(config) as opened:
        yield opened


def ask(session, key, payload=None, timeout=3.0):
    """All replies to a query, decoded."""
    data = payload if payload is None or isinstance(payload, bytes) else json.dumps(payload).encode()
    replies = session.get(key, payload=data, timeout=timeout)
    return [json.loads((r.ok or r.err).payload.to_bytes()) for r in replies]


def request(**fields):
    return {"source": "raw", "sequence": 1, "timestamp_ns": time.time_ns(), **fields}


def test_stop_needs_no_lease_and_reaches_every_robot_at_once(world, session):
    (reply,) = ask(session, "rtctl/*/stop", request())
    assert reply["accepted"]
    assert world.real_time.commands[-1]["verb"] == Verb.STOP


def test_everything_that_writes_needs_the_lease(world, session):
    for name, key in REQUESTS.items():
        fields = {"state_command": {"command": "enable"}, "param/set": {"values": {"a": 1}}}.get(name, {})
        (reply,) = ask(session, f"rtctl/planar/{name}", request(**fields))
        if key.lease:
            assert reply["reason"] == "no_lease", name
    assert all(c["verb"] == Verb.STOP for c in world.real_time.commands)


def test_state_command_is_crtk(world, session):
    (lease,) = ask(session, "rtctl/planar/lease/acquire", request())
    token = lease["result"]["lease"]
    (reply,) = ask(session, "rtctl/planar/state_command", request(command="enable", lease=token))
    assert reply["accepted"]
    assert world.real_time.commands[-1]["verb"] == Verb.ENABLE
    (reply,) = ask(session, "rtctl/planar/state_command", request(command="stop", lease=token, sequence=2))
    assert reply["reason"] == "unknown_command"


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (None, "malformed"),
        (b"", "malformed"),
        (b"\xff\xfe", "malformed"),
        (b"{}", "malformed"),
        (b'{"source": "a", "sequence": 1, "timestamp_ns": 0, "surprise": 1}', "malformed"),
        (b'{"source": "a", "sequence": 1, "timestamp_ns": 0, "valid_for_s": NaN}', "malformed"),
        (b'{"source": "a", "sequence": 1, "timestamp_ns": 0}', "expired"),
        (b'{"source": "a", "sequence": 1, "timestamp_ns": 9000000000000000000}', "clock"),
        (b" " * 70000, "oversized"),
    ],
)
def test_refusals(world, session, payload, reason):
    (reply,) = ask(session, "rtctl/planar/stop", payload)
    assert reply["accepted"] is False
    assert reply["reason"] == reason
    assert reply["text"]
    assert reply["remedy"]
    assert world.real_time.commands == []


def test_an_unknown_key_is_answered(session):
    assert [r["reason"] for r in ask(session, "rtctl/planar/fly", request())] == ["unknown_key"]
    assert [r["reason"] for r in ask(session, "rtctl/**", request())] == ["unknown_key"]
    assert [r["reason"] for r in ask(session, "rtctl/planar/param/*", request())] == ["unknown_key"]


def test_hundreds_of_random_payloads_are_all_answered(world, session):
    rng = random.Random(1)
    good = json.dumps(request(arguments=[1, 2, 3], valid_for_s=10.0)).encode()
    names = list(REQUESTS)
    for _ in range(300):
        data = bytearray(good)
        for _ in range(rng.randrange(1, 6)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        if rng.random() < 0.3:
            data = bytearray(rng.randbytes(rng.randrange(300)))
        name = rng.choice(names)
        replies = ask(session, f"rtctl/planar/{name}", bytes(data))
        assert len(replies) == 1
        assert isinstance(replies[0]["accepted"], bool)
    assert world.client().status()["state"] == "DISABLED"
    assert world.thread.is_alive()


def test_a_flood_is_answered_and_stop_gets_through(world, session):
    client = world.client()
    client.command(Verb.ENABLE)
    flood = [
        session.get("rtctl/planar/param/list", payload=json.dumps(request(valid_for_s=10.0)).encode(), timeout=20.0)
        for _ in range(1000)
    ]
    begin = world.real_time.tick
    assert client.stop().tick - begin < 1000
    reasons = [json.loads(r.ok.payload.to_bytes()).get("reason", "") for f in flood for r in f]
    assert len(reasons) == len(flood)
    assert set(reasons) <= {"", "overloaded"}
    assert client.status()["lost_records"] == 0


def test_a_stream_of_a_hundred_commands_arrives_in_order(world):
    client = world.client()
    client.command(Verb.ENABLE)
    for k in range(100):
        client.command(Verb.SERVO_CP, 150.0 + 0.01 * k, 0.0, 0.0)
    sent = [c["argument"][0] for c in world.real_time.commands if c["verb"] == Verb.SERVO_CP]
    assert sent == [150.0 + 0.01 * k for k in range(100)]


def test_a_full_mailbox_is_refused_at_once(world, session):
    world.real_time.mute = True
    payload = json.dumps(request(valid_for_s=10.0)).encode()
    waiting = [session.get("rtctl/planar/stop", payload=payload, timeout=5.0) for _ in range(80)]
    reasons = [json.loads(r.ok.payload.to_bytes())["reason"] for w in waiting for r in w]
    assert len(reasons) == 80
    assert set(reasons) == {"no_verdict", "overloaded"}


def test_password(make_world):
    made = make_world({"gateway": {"user": "surgeon", "password": "secret"}})
    made.real_time.start()
    made.serve()
    assert made.client(user="surgeon", password="secret").status()["robot"] == "planar"

    with pytest.raises(NoReply):
        Client(endpoint=made.endpoint, user="surgeon", password="wrong", timeout_s=0.5).status()
    with pytest.raises((NoReply, CommandRefused)):
        Client(endpoint=made.endpoint, timeout_s=0.5).status()
