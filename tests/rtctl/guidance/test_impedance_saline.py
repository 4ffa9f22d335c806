"""Calibration in saline: bias of every pair, dead pairs, refusals, and the way from a log to settings that guide."""

import numpy as np
import pytest

from hal.frames import INVALID, VALID
from rtctl.calibrate.errors import CalibrationError
from rtctl.cli import main
from rtctl.guidance.impedance.saline import calibrate, samples_of
from rtctl.lockstep import Lockstep
from rtctl.record import controller_table
from rtctl.settings import from_table, load
from rtctl.simulation import simulate

OPTIONS = from_table({}).impedance
FAR_OHM, PAIRS, SWEEPS = 1149.0, 21, 12
PLANT_FAR_OHM = 83.2 * 0.8**-1.317 + FAR_OHM
"""What the plant's pairs read in a bath beside their leads: the power law at the largest area, not c."""


def bath(noise_ohm=50.0, seed=1):
    """Samples (m,) of SWEEPS sweeps, and the bias behind them (21,)."""
    random = np.random.default_rng(seed)
    bias = random.uniform(100.0, 500.0, PAIRS)
    pair = np.tile(np.arange(PAIRS), SWEEPS)
    return pair, FAR_OHM + bias[pair] + random.normal(0.0, noise_ohm, pair.size), bias


def test_every_pair_reads_the_far_field_once_its_bias_is_taken_off():
    pair, ohm, bias = bath()
    found = calibrate(pair, ohm, OPTIONS, PAIRS, FAR_OHM)
    assert np.abs(found.bias_ohm - bias).max() < 4.0 * 50.0 / np.sqrt(SWEEPS)
    corrected = ohm - found.bias_ohm[pair]
    assert [corrected[pair == k].mean() for k in range(PAIRS)] == pytest.approx(np.full(PAIRS, FAR_OHM))
    assert found.left_out == []
    assert (found.samples == SWEEPS).all()
    assert np.median(found.deviation_ohm) == pytest.approx(50.0, rel=0.15)


def test_another_far_field_moves_every_bias_by_the_difference():
    pair, ohm, _ = bath()
    low, high = (calibrate(pair, ohm, OPTIONS, PAIRS, c).bias_ohm for c in (1149.0, 1320.0))
    assert low - high == pytest.approx(np.full(PAIRS, 171.0))


@pytest.mark.parametrize(
    ("value", "why"), [(28_800.0, "open"), (15.0, "shorted"), (np.nan, "reads no number"), (None, "noisy")]
)
def test_a_dead_pair_is_named_and_left_out(value, why):
    pair, ohm, bias = bath()
    ohm[pair == 6] = np.where(np.arange(SWEEPS) % 2, 3000.0, 1200.0) if value is None else value
    found = calibrate(pair, ohm, OPTIONS, PAIRS, FAR_OHM)
    assert found.left_out == [6]
    assert found.dead[6] == why
    assert found.bias_ohm[6] == 0.0
    assert np.abs(found.bias_ohm - bias)[np.arange(PAIRS) != 6].max() < 60.0


def test_too_few_samples_are_refused_with_the_pair():
    pair, ohm, _ = bath()
    keep = (pair != 13) | (np.arange(pair.size) < 3 * PAIRS)
    with pytest.raises(CalibrationError, match=r"pair 13 was hardly measured.*3 samples"):
        calibrate(pair[keep], ohm[keep], OPTIONS, PAIRS, FAR_OHM)


def test_an_array_outside_the_bath_is_refused():
    pair, ohm, _ = bath()
    ohm[pair >= 9] = 28_800.0
    with pytest.raises(CalibrationError, match="most pairs are dead"):
        calibrate(pair, ohm, OPTIONS, PAIRS, FAR_OHM)


def test_a_sample_counts_once_and_only_if_it_is_valid():
    rows = np.zeros(9, controller_table(3).dtype)
    rows["impedance_sequence"] = [0, 0, 1, 1, 2, 2, 3, 3, 4]
    rows["impedance_pair"] = [-1, -1, 0, 0, 1, 1, 2, 2, -1]
    rows["impedance_ohm"] = [np.nan, np.nan, 10, 10, 11, 11, 12, 12, np.nan]
    rows["impedance_validity"] = [INVALID] * 2 + [VALID] * 6 + [INVALID]
    pair, ohm = samples_of(rows)
    assert pair.tolist() == [0, 1, 2]
    assert ohm.tolist() == [10.0, 11.0, 12.0]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A simulated run with the array in a bath; a lead breaks."""
    settings = load(
        "planar-sim",
        [
            "workflow.depth_mm=1.0", "workflow.hold_s=0.1", "backend.options.impedance.bath=true",
            "backend.options.inject.open_channel_after_s=0.0", "backend.options.inject.open_channel=21",
        ],
    )  # fmt: skip
    path = tmp_path_factory.mktemp("bath") / "log.mcap"
    simulate(settings, 5, log=path)
    lockstep = Lockstep(settings, 5)
    series = lockstep.device.device[0]["impedance"]["series_ohm"].copy()
    lockstep.close()
    return path, series


def test_from_a_log_to_settings_that_guide(log, tmp_path, capsys):
    path, series = log
    to = tmp_path / "bias.toml"
    assert main(["calibrate", "saline", str(path), "--to", str(to)]) == 0
    said = capsys.readouterr()
    assert "pair 20 is open" in said.err
    settings = load("planar-sim", [f"@{to}", "impedance.guidance=true"])
    leads = series[:-1] + series[1:]
    found = np.array(settings.impedance.bias_ohm)
    assert np.abs(found - leads - (PLANT_FAR_OHM - FAR_OHM))[:20].max() < 45.0
    assert settings.impedance.left_out == (20.0,)
    assert "samples of 21 pairs" in to.read_text()


def test_the_far_field_can_be_said(log, tmp_path, capsys):
    path, series = log
    to = tmp_path / "bias.toml"
    assert main(["calibrate", "saline", str(path), "--to", str(to), "--far-field", f"{PLANT_FAR_OHM}"]) == 0
    capsys.readouterr()
    found = np.array(load("planar-sim", [f"@{to}"]).impedance.bias_ohm)
    assert np.abs(found - series[:-1] - series[1:])[:20].max() < 45.0


def test_a_log_that_is_none_is_refused(tmp_path, capsys):
    assert main(["calibrate", "saline", str(tmp_path / "nothing.mcap")]) != 0
    assert "nothing.mcap" in capsys.readouterr().err
