"""A step of the array that does not converge: told, without power, with a state that can be loaded."""

import numpy as np
import pytest

from hal.backend import failure_of
from hal.errors import BackendError
from hal.frames import Validity
from rtctl import simulation
from rtctl.lockstep import Lockstep
from rtctl.settings import load
from sim_backends.plant.snapshot import from_bytes
from studies import failed_step


@pytest.fixture
def broken(drive):
    """A bench with an array whose stiffness is not a number: no step can converge."""
    bench = drive()
    bench.load_array()
    bench.run(20, 0.5)
    assert failure_of(bench.backend) is None
    healthy = bench.backend.snapshot()
    bench.backend.compiled().device["array"]["stretch_n_per_mm"] = np.nan
    bench.run(1, 0.5)
    return bench, healthy


def test_the_bench_stands_still_without_power_and_measures_nothing(broken):
    bench, _ = broken
    assert bench.truth["failed"]
    before = bench.truth["pose_gripper_in_base"].copy()
    bench.run(50, 3.0)
    assert not bench.sensors["powered"][0]
    assert bench.sensors["axes_validity"][0] == bench.sensors["wrench_validity"][0] == Validity.INVALID
    assert np.isnan(bench.sensors["wrench_in_sensor"]).all()
    assert np.array_equal(bench.truth["pose_gripper_in_base"], before)
    assert np.isfinite(bench.truth["array_node_in_base_mm"]).all(), "the array is where it last was in equilibrium"


def test_the_failure_says_when_and_what_to_do(broken):
    bench, _ = broken
    error, state = failure_of(bench.backend)
    assert isinstance(error, BackendError)
    assert "tick" in str(error)
    assert "studies.failed_step" in str(error)
    assert from_bytes(state)["failed"][0]


def test_a_state_goes_on_exactly_where_it_was(drive, broken):
    bench, healthy = broken
    other = drive()
    other.load_array()
    other.run(20, 0.5)
    bench.backend.restore(healthy)
    one, two = (b.backend for b in (bench, other))
    assert one.snapshot() == two.snapshot() == healthy
    for backend in (one, two):
        backend.read(bench.tick + 40, bench.sensors)
    assert one.snapshot() == two.snapshot()
    assert failure_of(one) is None


@pytest.mark.parametrize("data", [b"", b"nonsense", bytes(100_000)])
def test_other_bytes_are_refused(drive, data):
    bench = drive()
    with pytest.raises(BackendError, match="not a state of the simulated bench"):
        bench.backend.restore(data)


def test_a_simulation_ends_with_the_cause_and_the_state_beside_its_log(tmp_path, monkeypatch, capsys):
    class Breaks(Lockstep):
        def advance(self, ticks):
            if self.tick > 100:
                self.device.device["array"]["stretch_n_per_mm"] = np.nan
            return super().advance(ticks)

    monkeypatch.setattr(simulation, "Lockstep", Breaks)
    result = simulation.simulate(load("planar-sim"), 1, log=tmp_path / "run.mcap")
    assert isinstance(result.failure, BackendError)
    assert result.failure.exit_code == 3
    state = tmp_path / "run.failed-step"
    assert from_bytes(state.read_bytes())["failed"][0]
    assert failed_step.main([str(state)]) == 1  # what is not a number stays none
    assert "in 1000 parts: failed" in capsys.readouterr().out
    assert failed_step.main([str(tmp_path / "none")]) == 1
