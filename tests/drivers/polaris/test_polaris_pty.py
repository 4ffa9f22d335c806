"""The tracker as another process on a pseudo terminal: with an independent client, and from poses to a calibrated backlash."""

import csv
import io
import math
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from polaris_bench import PtyTracker, rom

from drivers.polaris import join, record
from drivers.polaris.geometry import product, rotation, transform
from drivers.polaris.line import TrackerPort
from drivers.polaris.tracker import Tracker
from hal.errors import BackendError

RTCTL = str(Path(sys.executable).parent / "rtctl")


def test_an_independent_client_takes_the_emulator_for_a_tracker(tmp_path):
    """ndicapi speaks to it from a process of its own, as its calls hold the interpreter."""
    script = """
import sys, ndicapy as ndi
device = ndi.ndiOpen(sys.argv[1])
say = lambda what: print(what, flush=True)
command = lambda text: ndi.ndiCommand(device, text)
say(command("INIT:"))
say(command("COMM:50000"))
say(command("PHRQ:*********1****"))
assert ndi.ndiPVWRFromFile(device, 1, sys.argv[2]) == 0
say(command("PINIT:01"))
say(command("PENA:01D"))
say(command("PHSR:04"))
say(command("TSTART:80"))
command("TX:0801")
say(ndi.ndiGetTXTransform(device, b"\\x01"))
say(ndi.ndiGetTXFrame(device, b"\\x01"))
print(sys.stdin.readline(), end="", flush=True)
sys.stdin.readline()
command("TX:0801")
say(ndi.ndiGetTXTransform(device, b"\\x01"))
say(command("TSTOP:"))
try:
    command("TX:0801")
except OSError as error:
    say(str(error))
ndi.ndiClose(device)
"""
    with PtyTracker() as pty:
        pty.tell("step 3")
        command = [sys.executable, "-c", script, pty.path, str(rom(tmp_path, "t"))]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        process.stdin.write("hide it\n")
        process.stdin.flush()
        lines = []
        while not lines or lines[-1] != "hide it\n":
            lines.append(process.stdout.readline())
            assert lines[-1], lines
        pty.tell("inject missing 1")
        process.stdin.write("\n")
        process.stdin.close()
        lines += process.stdout.readlines()
        process.stdout.close()
        assert process.wait(timeout=10) == 0
    said = [line.strip() for line in lines]
    assert said[:6] == ["OKAY", "OKAY", "01", "OKAY", "OKAY", "0101031"]
    assert said[6] == "OKAY"
    transform_seen = [float(v) for v in said[7].strip("()").split(",")]
    assert transform_seen[:4] == pytest.approx([math.cos(0.15), 0, 0, math.sin(0.15)], abs=1e-4)
    assert transform_seen[4:7] == pytest.approx([0.0, 30.0, -1000.0])
    assert said[8] == "3"
    assert said[10] == "MISSING"
    assert said[11] == "OKAY"
    assert "0x0c" in said[12]


def test_the_rate_is_that_of_the_line(tmp_path):
    """At another rate the tracker sees no characters, until the client has found its rate."""
    with PtyTracker() as pty:
        line = TrackerPort(pty.path)
        line.set_baud(38_400)
        line.send(b"INIT:E3A5\r")
        assert line.receive(bytearray(10)) == -1
        with Tracker(line, reset_s=0.1, reply_s=0.3) as tracker:
            tracker.connect()
            tracker.load(rom(tmp_path, "t"))
            tracker.start()
            assert tracker.poses()[1][0] == 3
        with Tracker(TrackerPort(pty.path), reset_s=0.1, reply_s=0.3) as again:
            again.connect()
            assert again.enabled() == []


def test_a_port_that_is_not_there():
    with pytest.raises(BackendError, match="port cannot be opened"):
        TrackerPort("/dev/none")


class Steps:
    """Lines for the recorder: each moves the scene on first."""

    def __init__(self, pty, count, hidden=()):
        self._pty, self._count, self._hidden = pty, count, hidden

    def __iter__(self):
        for step in range(self._count):
            self._pty.tell(f"step {step}")
            self._pty.tell(f"inject missing {int(step in self._hidden)}")
            yield "\n"


def rows_of(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(io.StringIO("\n".join(lines))))


def test_a_hidden_pose_is_not_kept_and_the_numbers_go_on(tmp_path, capsys):
    with PtyTracker() as pty:
        out = tmp_path / "tracked.csv"
        arguments = ["--port", pty.path, "--tool", str(rom(tmp_path, "g")), "--out", str(out), "--frames", "3"]
        assert record.main(arguments, Steps(pty, 4, hidden=(1,))) == 0
        assert record.main(arguments, Steps(pty, 1)) == 2
    said = capsys.readouterr()
    assert "this pose is not kept, missing_g 30" in said.out
    assert "name a new one" in said.err
    rows = rows_of(out)
    assert [row["pose"] for row in rows] == ["1"] * 3 + ["2"] * 3 + ["3"] * 3
    assert [float(row["y_mm"]) for row in rows[::3]] == [0.0, 20.0, 30.0]
    frames = [int(row["frame"]) for row in rows]
    assert frames[:3] == [3, 6, 9]
    assert all(b > a for a, b in pairwise(frames))


def mounting(quaternion, place):
    q = np.array(quaternion) / np.linalg.norm(quaternion)
    return q, np.array(place), transform(q, np.array(place))


def test_from_tracked_poses_to_the_backlash_of_the_wire_drives(tmp_path):
    """A simulated robot's poses, seen by the emulated tracker in a frame of its own, calibrate as if they were given directly."""
    count = 24
    direct = tmp_path / "direct.csv"
    subprocess.run([RTCTL, "calibrate", "record", str(direct), "planar-sim", "--poses", str(count)], check=True, capture_output=True)  # fmt: skip
    rows = rows_of(direct)
    motors = tmp_path / "motors.csv"
    names = [name for name in rows[0] if name.startswith(("motor", "extending"))]
    motors.write_text("\n".join([",".join(names), *(",".join(row[n] for n in names) for row in rows)]) + "\n")
    base_q, base_mm, base = mounting([0.9, 0.1, -0.3, 0.2], [120.0, -35.0, 80.0])
    tool_q, tool_mm, tool = mounting([0.7, 0.1, 0.7, -0.1], [4.0, 60.0, -22.0])
    scene = tmp_path / "scene"
    scene.write_text("\n".join(_tracked(row, base, base_q, tool, tool_q) for row in rows))
    registration = tmp_path / "mounting.toml"
    registration.write_text(
        f"base_from_reference = {{ quaternion = {base_q.tolist()}, position_mm = {base_mm.tolist()} }}\n"
        f"tool_from_gripper = {{ quaternion = {tool_q.tolist()}, position_mm = {tool_mm.tolist()} }}\n"
    )
    tracked, joined = tmp_path / "tracked.csv", tmp_path / "poses.csv"
    with PtyTracker(scene) as pty:
        arguments = ["--port", pty.path, "--tool", str(rom(tmp_path, "gripper")), "--reference", str(rom(tmp_path, "base")), "--out", str(tracked), "--frames", "2"]  # fmt: skip
        assert record.main(arguments, Steps(pty, count)) == 0
    assert join.main([str(tracked), str(motors), "--registration", str(registration), "--out", str(joined)]) == 0
    for found, true in zip(rows_of(joined), rows, strict=True):
        assert [float(found[n]) for n in names] == pytest.approx([float(true[n]) for n in names])
        assert float(found["x_mm"]) == pytest.approx(float(true["x_mm"]), abs=0.05)
        assert float(found["y_mm"]) == pytest.approx(float(true["y_mm"]), abs=0.05)
        assert float(found["phi_rad"]) == pytest.approx(float(true["phi_rad"]), abs=5e-4)
    results = [_backlash(path, tmp_path / f"{path.stem}.toml") for path in (direct, joined)]
    assert results[1] == pytest.approx(results[0], abs=0.4)  # 0.01 mm and 0.1 mrad of the tracker's last digits
    assert min(results[0][:3]) > 0.5
    assert join.main([str(tracked), str(motors), "--registration", str(registration), "--out", str(joined)]) == 2


def _tracked(row, base, base_q, tool, tool_q):
    """A line of the scene: the tracked tool in the frame of a tracker that looks along the reference tool's axes from a metre."""
    x, y, phi = (float(row[n]) for n in ("x_mm", "y_mm", "phi_rad"))
    gripper_q = np.array([math.cos(phi / 2), 0.0, 0.0, math.sin(phi / 2)])
    gripper = transform(gripper_q, np.array([x, y, 0.0]))
    seen = np.linalg.inv(base) @ gripper @ np.linalg.inv(tool)
    q = product(product(base_q * (1, -1, -1, -1), gripper_q), tool_q * (1, -1, -1, -1))
    assert rotation(q) == pytest.approx(seen[:3, :3])
    return " ".join(f"{v:.9f}" for v in (*q, *(seen[:3, 3] + (0, 0, -1000.0))))


def _backlash(poses, to):
    import tomllib

    subprocess.run([RTCTL, "calibrate", "backlash", str(poses), "planar-sim", "--to", str(to)], check=True, capture_output=True)  # fmt: skip
    return tomllib.loads(to.read_text())["control"]["backlash_rad"]


@pytest.mark.parametrize(
    ("tracked", "motors", "registration", "says"),
    [
        ("x,y\n1,2", "motor1_rad\n1", None, "no file of tracked poses"),
        (record.COLUMNS + "\n1,3,0,0,0,1,0,0,0,0.1", "motor1_rad\n1\n2", None, "not as many motor angles"),
        (record.COLUMNS + "\n2,3,0,0,0,1,0,0,0,0.1", "motor1_rad\n1", None, "not numbered"),
        (record.COLUMNS + "\n1,3,0,0,zero,1,0,0,0,0.1", "motor1_rad\n1", None, "cannot be read"),
        (record.COLUMNS + "\n1,3,0,0,0,1,0,0,0,0.1", "motor1_rad\n1", "base_from_reference = 3", "no transform"),
        (record.COLUMNS + "\n1,3,0,0,0,1,0,0,0,0\n2,6,0,0,9,1,0,0,0,0", "motor1_rad\n1\n2", None, "in one plane"),
    ],
)
def test_what_cannot_be_joined_is_refused(tmp_path, tracked, motors, registration, says, capsys):
    here = "{ quaternion = [1, 0, 0, 0], position_mm = [0, 0, 0] }"
    registration = registration or f"base_from_reference = {here}\ntool_from_gripper = {here}"
    for name, text in (("t", tracked), ("m", motors), ("r", registration)):
        (tmp_path / name).write_text(text)
    arguments = [str(tmp_path / "t"), str(tmp_path / "m"), "--registration", str(tmp_path / "r")]
    assert join.main([*arguments, "--out", str(tmp_path / "o")]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "o").exists()
