"""What `make run` does: a whole insertion through the real daemon, from the command line to the report."""

import json
import re
import subprocess
import sys

from bench_daemon import PATIENT, free_endpoint

from rtctl import replay
from rtctl.log.reader import Log


def test_a_demo_leaves_a_whole_insertion_with_its_report(tmp_path):
    directory = tmp_path / "run"
    command = [sys.executable, "-m", "rtctl", "demo", "planar-sim", "--run-directory", str(directory)]
    overrides = (
        "robot.name=demo-test",
        f"gateway.endpoint={free_endpoint()}",
        "workflow.depth_mm=5.0",
        "workflow.hold_s=0.2",
        *PATIENT,
    )
    for assignment in overrides:
        command += ["--set", assignment]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((directory / "summary.json").read_text())
    assert summary["outcome"] == "completed"
    assert summary["depth_mm"] == 5.0
    assert summary["lost_records"] == 0
    assert summary["insertion_force_peak_n"] > 0.004, "the array touched something"
    page = (directory / "report.html").read_text()
    assert page.count("<svg") + page.count("<img") >= 5
    assert not re.search(r'(src|href)="https?://', page), "nothing is fetched"
    log = Log.open(directory / "log.mcap")
    assert log.complete
    assert log.truth is not None
    assert "not rehearsed" not in (directory / "daemon.txt").read_text()
    assert replay.run([directory / "log.mcap"]).identical
