"""Driving by hand through a real daemon: it moves while the deadman is held, and rests whoever dies."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from bench_daemon import DaemonUnderTest, eventually

from rtctl.commands import Verb
from rtctl.lifecycle import Condition, Operating

OPERATOR = """
import sys, time
from rtctl.operator.publisher import Publisher, Sample, publish
from rtctl.operator.scripted import Scripted
held = Sample((3.0, 0, 0, 0, 0, 0), deadman=True)
seconds = [float(s) for s in sys.argv[3:]]
script = Scripted([(s, held if k % 2 else Sample()) for k, s in enumerate(seconds)])
with Publisher(sys.argv[1], sys.argv[2], "script", "base") as publisher:
    last = False
    def send(sample):
        global last
        if sample.deadman != last:
            print(time.time_ns(), flush=True)
            last = sample.deadman
        publisher.send(sample)
    publish(script, send)
"""
SPEED_MM_PER_S, JERK_MM_PER_S3 = 3.0, 400.0
AGE_S, STREAM_S = 0.1, 0.05
BRAKE_S = 2.0 * (SPEED_MM_PER_S / JERK_MM_PER_S3) ** 0.5
"""Jerk-limited, without reaching the limit of acceleration."""
SLACK_S = 0.1
"""A shared machine stalls as it likes."""


@pytest.fixture
def daemon(tmp_path):
    made = DaemonUnderTest(tmp_path / "run").wait_until_ready()
    yield made
    made.close()


@pytest.fixture
def spawn():
    """Starts a Python program, and kills it in the end."""
    started = []

    def start(*command):
        started.append(subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


def line(process):
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_the_robot_follows_a_held_deadman_and_rests_when_it_or_a_process_is_gone(daemon, spawn):
    def operator(*seconds):
        return spawn("-c", OPERATOR, daemon.name, daemon.endpoint, *map(str, seconds))

    def bridge():
        follow = ["follow", "--robot", daemon.name, "--endpoint", daemon.endpoint]
        made = spawn("-m", "rtctl", "operate", *follow, "--age", "100", "--stage", "4", "--speed", "3")
        assert "following" in line(made)
        return made

    with daemon.client() as client:
        client.command(Verb.ENABLE)
        client.command(Verb.HOME)
        client.wait(lambda r: r["is_homed"] and not r["is_busy"], 20, "homed")
    losses = []
    with daemon.client("watcher") as watcher:
        following = bridge()

        hand = operator(0.8, 0.6, 0.3)
        line(hand)
        losses.append(("release", int(line(hand)), STREAM_S))
        assert hand.wait(10) == 0
        assert line(following) == "deadman released"

        hand = operator(0.8, 60.0)
        line(hand)
        watcher.wait(lambda r: r["is_busy"], 5, "motion")
        time.sleep(0.5)
        losses.append(("operator killed", time.time_ns(), AGE_S + STREAM_S))
        os.kill(hand.pid, signal.SIGKILL)
        assert "stopped coming" in line(following)
        eventually(lambda: not watcher.latest()["is_busy"], what="rest")

        hand = operator(1.2, 60.0)  # the bridge forgets the dead operator first
        line(hand)
        watcher.wait(lambda r: r["is_busy"], 5, "motion")
        time.sleep(0.5)
        losses.append(("bridge killed", time.time_ns(), STREAM_S))
        os.kill(following.pid, signal.SIGKILL)
        eventually(lambda: not watcher.latest()["is_busy"], what="rest")

        eventually(lambda: not watcher.status()["lease_holder"], what="the lease of the dead bridge ends")
        following = bridge()
        time.sleep(0.5)
        assert not watcher.latest()["is_busy"], "the deadman was held when the bridge came"
        assert watcher.latest()["operating_state"] == Operating.ENABLED
        following.send_signal(signal.SIGTERM)
        assert following.wait(10) == 0
    assert daemon.terminate() == 0

    rows = daemon.log().controller
    x, time_ns = rows["pose_desired"][:, 0], rows["time_ns"]
    speed = np.gradient(x, 0.001)
    for what, at_ns, notice_s in losses:
        at = np.searchsorted(time_ns, at_ns)
        assert speed[at - 50 : at].min() > 0.9 * SPEED_MM_PER_S, f"{what}: it was moving"
        braking = x[at - 50 : at + 1000]
        assert np.isfinite(braking).all()
        assert np.abs(np.diff(braking, 3)).max() / 1e-9 < 1.02 * JERK_MM_PER_S3, f"{what}: a jerk-limited brake"
        moving = np.flatnonzero(np.abs(speed[at : at + 1000]) > 1e-3)
        rest_s = (time_ns[at + moving[-1]] - at_ns) / 1e9
        print(f"{what}: at rest after {1e3 * rest_s:.0f} ms")
        assert rest_s < notice_s + BRAKE_S + SLACK_S, what
    silent = rows["condition_active"] >> Condition.STREAM_SILENT & 1
    killed = np.searchsorted(time_ns, losses[-1][1])
    assert silent[killed : killed + 200].any(), "the controller ended the stream of the dead bridge by itself"
