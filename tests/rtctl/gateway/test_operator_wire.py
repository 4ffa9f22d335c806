"""The operator's message on its way through a gateway, and the commands of `rtctl operate` at its ends."""

import os
import pty
import signal
import subprocess
import sys
import time

import pytest

from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.client import open_session
from rtctl.commands import Verb
from rtctl.gateway.keys import OPERATOR_TWIST
from rtctl.operator.message import MessageError, decode
from rtctl.operator.publisher import Publisher, Sample

HELD = Sample((1.0, 0, 0, 0, 0, 0), deadman=True)


@pytest.fixture
def heard(world):
    """Every message on the operator's key, as bytes, from another session."""
    payloads = []
    key = f"rtctl/{world.settings.robot.name}/{OPERATOR_TWIST}"
    with open_session(world.endpoint) as session:
        session.declare_subscriber(key, lambda sample: payloads.append(sample.payload.to_bytes()))
        world.client().status()
        yield payloads


def until(holds, timeout_s=5.0):
    end = time.monotonic() + timeout_s
    while not holds() and time.monotonic() < end:
        time.sleep(0.01)
    return holds()


def test_messages_arrive_in_order_and_the_last_one_releases(world, heard):
    with Publisher(world.settings.robot.name, world.endpoint, "script") as publisher:
        assert until(lambda: publisher.send(HELD) or heard)
        heard.clear()
        for _ in range(100):
            publisher.send(HELD)
            time.sleep(0.002)
    assert until(lambda: not decode(heard[-1]).deadman)
    messages = [decode(payload) for payload in heard]
    numbers = [message.sequence for message in messages]
    assert numbers == sorted(set(numbers))
    assert len(numbers) > 90
    assert {message.source for message in messages} == {f"script-{os.uname().nodename}-{os.getpid()}"}
    assert all(message.deadman for message in messages[:-1])
    assert abs(messages[-1].timestamp_ns - time.time_ns()) < 5e9


def test_whatever_is_published_there_is_nothing_to_the_gateway(world, heard):
    with open_session(world.endpoint) as session:
        for payload in (b"", b"\xff" * 100_000, b"[" * 5000):
            session.put(f"rtctl/{world.settings.robot.name}/{OPERATOR_TWIST}", payload)
        assert until(lambda: len(heard) == 3)
    for payload in heard:
        with pytest.raises(MessageError):
            decode(payload)
    assert world.client().command(Verb.ENABLE).tick is not None


@pytest.fixture
def at(world):
    """Options that lead a command to the gateway; signal handlers of the commands end with the test."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    yield ["--robot", world.settings.robot.name, "--endpoint", world.endpoint]
    for number, handler in before.items():
        signal.signal(number, handler)


def test_following_needs_the_lease(world, at, capsys):
    world.client("somebody").command(Verb.ENABLE)
    assert main(["operate", "follow", *at]) == Exit.REFUSED
    assert "somebody holds the lease" in capsys.readouterr().err


@pytest.mark.usefixtures("at")
def test_what_is_not_there_is_told(capsys, tmp_path):
    assert main(["operate", "gamepad", "--device", str(tmp_path / "event7")]) == Exit.UNREACHABLE
    assert "event7" in capsys.readouterr().err
    assert main(["operate", "follow", "--endpoint", "tcp/127.0.0.1:1"]) == Exit.UNREACHABLE


def test_a_person_at_a_terminal_publishes_until_asked_to_end(at, heard):
    person, terminal = pty.openpty()
    command = [sys.executable, "-m", "rtctl", "operate", "keyboard", "--speed", "0.5", "--base-frame", *at]
    process = subprocess.Popen(command, stdin=terminal, stderr=subprocess.PIPE, text=True)
    try:
        assert until(lambda: len(heard) > 3, 20.0)
        assert not any(decode(payload).deadman for payload in heard)
        os.write(person, b"w")
        assert until(lambda: decode(heard[-1]).deadman)
        message = decode(heard[-1])
        assert (message.twist, message.frame) == ((0.5, 0, 0, 0, 0, 0), "base")
        assert until(lambda: not decode(heard[-1]).deadman), "a tap is no more than a nudge"
        os.write(person, b"d")
        assert until(lambda: decode(heard[-1]).twist[1] == -0.5)
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == Exit.OK
        assert until(lambda: not decode(heard[-1]).deadman)
    finally:
        process.kill()
        process.communicate()
        os.close(person)
        os.close(terminal)
