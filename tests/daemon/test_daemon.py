"""The daemon from outside: its promises when it is stopped, killed, frozen, starved or doubled."""

import os
import signal
import subprocess
import time

import numpy as np
import pytest
from bench_daemon import DaemonUnderTest, eventually

from rtctl import replay
from rtctl.commands import Verb
from rtctl.lifecycle import Condition, Operating
from rtctl.log.recover import recover


@pytest.fixture
def start(tmp_path):
    started = []

    def make(*overrides, directory="run", name=None):
        started.append(DaemonUnderTest(tmp_path / directory, *overrides, name=name))
        return started[-1]

    yield make
    for daemon in started:
        daemon.close()


def has(record, condition):
    return bool(record["condition_active"] >> condition & 1)


def enable_and_move(client):
    """Enabled, homed, and on its way for some seconds."""
    client.command(Verb.ENABLE)
    client.command(Verb.HOME)
    client.wait(lambda r: r["is_homed"], 20, "homed")
    client.command(Verb.MOVE_CP, 165.0, 1.0, 0.0)


def test_sigterm_in_motion_ends_at_rest_without_power_and_with_a_whole_log(start):
    daemon = start().wait_until_ready()
    with daemon.client() as client:
        enable_and_move(client)
        time.sleep(0.5)
        assert daemon.terminate() == 0
    assert "not rehearsed" not in daemon.output
    log = daemon.log()
    rows = log.controller
    assert log.complete
    assert log.missing_ticks() == []
    assert rows["tick"][0] - rows["missed_ticks"][0] == 0
    assert rows[-1]["operating_state"] == Operating.DISABLED
    assert not rows[-1]["power_request"]
    assert (rows[-1]["command_applied_v"] == 0).all()
    speed = np.linalg.norm(np.diff(rows["pose_desired"][:, :2], axis=0), axis=1) / 0.001
    assert np.nanmax(speed) > 1.0, "it was moving"
    off = np.flatnonzero(rows["command_verb"] == Verb.DISABLE)[-1]
    assert speed[off - 2] < 1e-3, "it came to rest before power went"  # the profile ends within a tick
    assert replay.run([daemon.directory / "log.mcap"]).identical


def test_a_second_instance_is_refused(start):
    daemon = start(name="twin").wait_until_ready()
    second = start(directory="second", name="twin")
    assert second.wait() == 3
    assert "already running" in second.output
    assert daemon.process.poll() is None
    assert daemon.terminate() == 0


def test_a_killed_real_time_process_is_told_and_never_restarted(start):
    daemon = start().wait_until_ready()
    with daemon.client() as client:
        enable_and_move(client)
        os.kill(daemon.child("rtctl.realtime"), signal.SIGKILL)
        assert daemon.wait() == 5
    assert "died" in daemon.output
    log = daemon.log()
    assert log.complete
    assert any("real-time process" in e["text"] for e in log.events)
    assert log.controller["is_homed"][-1]
    assert replay.run([daemon.directory / "log.mcap"]).identical


def test_a_killed_gateway_pauses_the_motion_and_comes_back_without_losing_a_record(start):
    daemon = start("safety.heartbeat_ticks=200").wait_until_ready()
    with daemon.client() as client:
        enable_and_move(client)
        victim = daemon.child("rtctl.gateway")
        os.kill(victim, signal.SIGKILL)
        eventually(lambda: daemon.child("rtctl.gateway") not in (victim, -1), what="a new gateway")
    with daemon.client_again() as client:
        eventually(lambda: client.latest() is not None, what="records of the new gateway")
        assert client.latest()["operating_state"] == Operating.PAUSED
        assert client.latest()["condition_latched"] >> Condition.GATEWAY_LOST & 1
        client.command(Verb.RESUME)
        client.wait(lambda r: r["operating_state"] == Operating.ENABLED, 2, "resumed")
        assert daemon.terminate() == 0
    assert (daemon.directory / "log-2.mcap").exists()
    recovered = recover(daemon.directory / "log.mcap", daemon.directory / "recovered.mcap")
    assert recovered.rows > 0
    log = daemon.log()
    ticks, missed = log.controller["tick"], log.controller["missed_ticks"]
    lost = np.flatnonzero(np.diff(ticks) - 1 - missed[1:])
    assert len(lost) <= 1, "only where the killed gateway had not yet written its chunk"


def test_a_gateway_that_dies_too_often_ends_the_daemon_safely_and_not_as_a_success(start):
    daemon = start().wait_until_ready()
    while daemon.process.poll() is None:
        victim = daemon.child("rtctl.gateway")
        if victim > 0:
            os.kill(victim, signal.SIGKILL)
        time.sleep(0.3)
    assert daemon.wait() != 0
    assert "too often" in daemon.output
    assert "died" not in daemon.output, "the loop ended in its safe state"


def test_a_frozen_loop_loses_power_by_the_watchdog_of_the_device(start):
    daemon = start("backend.options.watchdog_ticks=100").wait_until_ready()
    with daemon.client() as client:
        enable_and_move(client)
        victim = daemon.child("rtctl.realtime")
        os.kill(victim, signal.SIGSTOP)
        time.sleep(0.4)
        os.kill(victim, signal.SIGCONT)
        client.wait(lambda r: r["operating_state"] == Operating.FAULT, 5, "fault")
        record = client.latest()
        assert record["fault_cause"] == Condition.WATCHDOG
        assert not record["powered"]
        assert not record["power_request"]
        status = client.status()
        assert status["fault_cause"]["remedy"]
        client.command(Verb.ACKNOWLEDGE)
        client.wait(lambda r: r["operating_state"] == Operating.DISABLED, 2, "acknowledged")
        client.command(Verb.ENABLE)
        client.wait(lambda r: r["powered"], 2, "power again")
        assert daemon.terminate() == 0
    assert replay.run([daemon.directory / "log.mcap"]).identical


def test_a_plant_that_goes_silent_is_a_fault_without_power(start):
    daemon = start("backend.options.inject.axes_silent_after_s=10.0").wait_until_ready()
    with daemon.client() as client:
        client.command(Verb.ENABLE)
        client.wait(lambda r: r["operating_state"] == Operating.FAULT, 15, "fault")
        record = client.latest()
        assert record["fault_cause"] == Condition.AXES_LOST
        assert not record["power_request"]
        assert daemon.terminate() == 0


@pytest.mark.skipif(os.geteuid() != 0, reason="needs to mount a small file system")
def test_a_full_disk_pauses_and_keeps_what_was_recorded(start, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "none", str(disk)], capture_output=True)
    if mounted.returncode != 0:
        pytest.skip("cannot mount here")
    try:
        daemon = start(directory="disk/run").wait_until_ready()
        with daemon.client() as client:
            client.command(Verb.ENABLE)
            client.wait(lambda r: r["operating_state"] == Operating.PAUSED, 30, "paused by the full disk")
            assert client.latest()["condition_latched"] >> Condition.LOG_FAILED & 1
            assert client.status()["log_failure"]
            assert daemon.terminate() == 0
        log = daemon.log()
        assert len(log.controller) > 500
        assert log.missing_ticks() == []
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)


def test_a_killed_supervisor_takes_its_children_along(start):
    daemon = start().wait_until_ready()
    children = [daemon.child("rtctl.realtime"), daemon.child("rtctl.gateway")]
    daemon.process.kill()
    daemon.process.wait()
    eventually(lambda: not any(os.path.exists(f"/proc/{c}") for c in children), what="the children end")  # noqa: PTH110
    log = daemon.log()
    assert log.complete
    assert log.controller[-1]["operating_state"] == Operating.DISABLED
