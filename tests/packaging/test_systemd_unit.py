"""The unit says what the program needs and does, and the install target puts everything in its place."""

import configparser
import shutil
import subprocess
from pathlib import Path

import pytest
import typer

from hal.options import describe
from rtctl.cli import app
from rtctl.daemon import START_LIMIT_S, STOP_LIMIT_S
from rtctl.settings import Loop

ROOT = Path(__file__).resolve().parents[2]
UNIT = ROOT / "packaging" / "systemd" / "rtctl@.service"


@pytest.fixture(scope="module")
def service():
    parser = configparser.ConfigParser(interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(UNIT.read_text())
    return parser["Service"]


def test_times_leave_the_supervisor_room(service):
    assert int(service["TimeoutStopSec"]) > 2 * STOP_LIMIT_S  # the motion, then the log
    assert int(service["TimeoutStartSec"]) > START_LIMIT_S


def test_every_priority_the_settings_allow_is_granted(service):
    (field,) = (field for name, _, field in describe(Loop) if name == "priority")
    assert int(service["LimitRTPRIO"]) >= field.metadata["high"]
    assert service["LimitMEMLOCK"] == "infinity"


def test_only_the_gateway_is_ever_restarted(service):
    assert service["Restart"] == "no"
    assert service["OOMPolicy"] == "continue"
    assert (service["KillMode"], service["KillSignal"]) == ("mixed", "SIGTERM")


def test_systemd_is_told_by_the_supervisor(service):
    assert (service["Type"], service["NotifyAccess"]) == ("notify", "main")
    assert int(service["WatchdogSec"]) > 0


@pytest.mark.parametrize(
    "key",
    [
        "RestrictRealtime",
        "PrivateDevices",
        "ProtectClock",
        "MemoryDenyWriteExecute",
        "CPUSchedulingPolicy",
        "PrivateNetwork",
    ],
)
def test_nothing_is_closed_that_the_loop_needs(service, key):
    assert key not in service


@pytest.mark.parametrize("key", ["ExecStartPre", "ExecStart"])
def test_commands_exist(service, key):
    program, *arguments = service[key].split()
    assert program == "@PREFIX@/bin/rtctl"
    root = typer.main.get_command(app)
    command = root.commands[arguments[0]]
    command.make_context(arguments[0], arguments[1:])


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_understands_the_unit(tmp_path):
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "rtctl"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    text = UNIT.read_text().replace("@PREFIX@", str(tmp_path))
    (tmp_path / "rtctl@.service").write_text(text)
    command = ["systemd-analyze", "verify", str(tmp_path / "rtctl@planar-sim.service")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "rtctl@" not in result.stderr
    assert result.returncode == 0


def test_make_install_replaces_the_prefix_everywhere():
    """`sed` without a g replaces one occurrence a line."""
    assert all(line.count("@PREFIX@") <= 1 for line in UNIT.read_text().splitlines())
