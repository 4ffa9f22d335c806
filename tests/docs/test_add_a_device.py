"""The worked example of docs/how-to/add-a-device.md, as it stands there: in a whole controller, through the conformance suite, broken."""

import importlib.util
import textwrap
from pathlib import Path

import numpy as np
import pytest

from hal import device, emulator
from hal.backend import load as load_backend
from hal.conformance import CHECKS
from hal.errors import BackendError, OptionError
from hal.frames import INVALID, VALID
from hal.troubles import Trouble
from rtctl.commands import Verb
from rtctl.lockstep import Lockstep
from rtctl.settings import from_table, load, table_of

DOCS = Path(__file__).resolve().parents[2] / "docs"
DRIVER, DOUBLE = DOCS / "examples" / "udp_load_cell.py", DOCS / "examples" / "udp_load_cell_emulator.py"
TABLE = {"kind": "udp_load_cell", "name": "force_sensor", "peer": "192.168.1.20:4000", "local": "192.168.1.10:4000"}


def module(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    """As if somebody's package had named them in its entry points."""
    for registry, path, name in ((device, DRIVER, "LoadCell"), (emulator, DOUBLE, "EmulatedLoadCell")):
        known, mine = registry.load, getattr(module(path), name)
        monkeypatch.setattr(
            registry, "load", lambda kind, known=known, mine=mine: mine if kind == TABLE["kind"] else known(kind)
        )
    monkeypatch.setattr("drivers.backend.load", device.load)


def settings(**changes):
    table = table_of(load("planar-hil"))
    devices = [
        {**TABLE, **changes} if e["name"] == "force_sensor" else e for e in table["backend"]["options"]["devices"]
    ]
    table["backend"]["options"]["devices"] = devices
    table["backend"]["name"] = "rig"
    return from_table(table)


@pytest.fixture
def rig():
    lockstep = Lockstep(settings(), 3)
    lockstep.advance(60)
    return lockstep


@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.__name__)
def test_the_backend_with_it_keeps_every_promise(check):
    check(lambda: load_backend("rig", settings().backend.options, period_s=0.001, seed=7))


def test_the_controller_feels_what_the_bench_bears(rig):
    rig.command(Verb.ENABLE)
    record = rig.advance(200)
    assert record["powered"]
    assert record["wrench_validity"] == VALID
    assert record["wrench_in_sensor"] == pytest.approx(rig.backend.rig.bench.wrench_in_sensor, rel=1e-6)
    assert record["wrench_age_ticks"] == 0


@pytest.mark.parametrize(
    ("fault", "value", "trouble", "most", "then"),
    [
        ("silence", 1, Trouble.SENSOR_SILENT, 6, INVALID),
        ("corrupt", 1, Trouble.DATAGRAM_CORRUPT, 1, INVALID),
        ("not_a_number", 1, Trouble.DATAGRAM_CORRUPT, 1, INVALID),
        ("drop", 3, Trouble.DATAGRAM_GAP, 4, VALID),
    ],
)
def test_its_faults_are_seen_and_mended(rig, fault, value, trouble, most, then):
    rig.backend.rig.inject("force_sensor", fault, value)
    seen = next(n for n in range(1, 100) if rig.advance(1)["trouble"] == trouble)
    assert seen == most
    record = rig.advance(10)
    assert record["wrench_validity"] == then
    assert np.isnan(record["wrench_in_sensor"]).all() == (then == INVALID)
    rig.backend.rig.inject("force_sensor", fault, 0)
    record = rig.advance(3)
    assert (record["trouble"], record["wrench_validity"]) == (0, VALID)


def test_settings_and_faults_that_are_wrong_are_refused(rig):
    with pytest.raises(OptionError, match="silent_tick"):
        Lockstep(settings(silent_tick=3), 0)
    with pytest.raises(BackendError, match="no such fault"):
        rig.backend.rig.inject("force_sensor", "explode")


def test_the_page_shows_what_the_files_say():
    page = (DOCS / "how-to" / "add-a-device.md").read_text()
    for path, first, last in (
        (DRIVER, "    def read(", "    def write("),
        (DOUBLE, "    def sense(", "    def drive("),
    ):
        text = path.read_text()
        assert textwrap.dedent(text[text.index(first) : text.index(last)]).rstrip() in page
    assert all(f"`{fault}`" in page for fault in module(DOUBLE).EmulatedLoadCell.faults)
