"""The whole chain in real time: emulated devices, drivers, real-time process, gateway, client, each in its process."""

import subprocess
import sys
import time

import pytest
from bench_daemon import free_endpoint

from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.hil import comparison
from rtctl.hil.processes import RigProcesses
from rtctl.recording import logs_in, open_recording
from rtctl.settings import load

SHORT = ("workflow.depth_mm=2.5", "workflow.hold_s=0.1", "robot.name=hil", "backend.options.seams=rig:test")


@pytest.mark.skipif(sys.platform != "linux", reason="shared memory of Linux")
def test_an_insertion_through_the_drivers_agrees_with_the_plant(tmp_path, capsys):
    arguments = [a for s in (*SHORT, f"gateway.endpoint={free_endpoint()}") for a in ("--set", s)]
    code = main(["bench", "hil", "planar-hil", "--run-directory", str(tmp_path), *arguments])
    told = capsys.readouterr()
    records = open_recording(logs_in(tmp_path)).records
    assert code == Exit.OK, told.err[-2000:]
    assert "through the drivers" in told.out
    assert records["depth_mm"].max() == pytest.approx(2.5)
    assert set(records["impedance_validity"].tolist()) >= {1}, "the telemetry came through its socket"
    assert len(comparison.SIGNALS) == told.out.count(" yes ")


def test_a_dead_loop_leaves_the_emulated_amplifiers_without_power(tmp_path):
    """The cards' watchdogs open the enable chain although their outputs hold."""
    from sim_backends.emulators.sensoray526 import CARD
    from sim_backends.rig import memory

    settings = load("planar-hil", [*SHORT, "log.directory=" + str(tmp_path)])
    with RigProcesses(settings, 0, tmp_path / "rig.txt") as bench:
        card = memory.attach("test", "card-2c0", CARD)
        script = (
            "import time, numpy as np\n"
            "from hal.backend import load as backend\nfrom hal.frames import *\nfrom rtctl.settings import load\n"
            f"s = load('planar-hil', {[*SHORT]!r})\n"
            "b = backend('hardware', s.backend.options, period_s=0.001, seed=0)\nb.open()\n"
            "x, a = np.zeros(1, sensor_frame(4)), np.zeros(1, actuator_frame(4))\n"
            "t = 0\n"
            "while True:\n"
            "    t += 1; b.read(t, x); a['power'] = t > 20; b.write(t, a)\n"
            "    if t == 200: print(int(x[0]['powered']), flush=True)\n"
            "    time.sleep(0.001)\n"
        )
        driver = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
        assert driver.stdout is not None
        assert driver.stdout.readline() == "1\n"
        assert not card["watchdog_expired"][0]
        driver.kill()
        driver.wait()
        time.sleep(0.5)
        bench.check()
        assert card["watchdog_expired"][0]
