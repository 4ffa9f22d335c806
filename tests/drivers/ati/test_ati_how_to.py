"""The settings of the how-to are those the drivers and the emulators take."""

import re
import tomllib
from pathlib import Path

import pytest

from hal import device, emulator

DOCS = Path(__file__).parents[3] / "docs"
BLOCKS = re.findall("```toml\n(.*?)```", (DOCS / "how-to" / "wire-an-ati-sensor.md").read_text(), re.S)
MOUNTING = tomllib.loads(BLOCKS[0])
ENTRIES = [tomllib.loads(block)["backend"]["options"]["devices"][0] for block in BLOCKS[1:]]


@pytest.mark.parametrize("entry", ENTRIES, ids=[e["kind"] for e in ENTRIES])
def test_settings_of_the_page_measure_a_wrench(lockstep, entry):
    table = {**entry, **MOUNTING}
    kind, name = table.pop("kind"), table.pop("name")
    if "calibration" in table:
        table |= {"calibration": "example-sensor.cal", "card": "card"}
    rig = lockstep()
    sensor, _ = rig.add(device.load(kind), emulator.load(kind), name, table)
    assert sensor.measures == {"wrench"}
    rig.bench.wrench_in_sensor[:] = [1.0, -2.0, 3.0, 10.0, 20.0, -30.0]
    rig.steps(100)
    assert rig.readings.wrench_in_sensor == pytest.approx(rig.bench.wrench_in_sensor, abs=0.7)


def test_every_kind_has_its_settings_on_the_page():
    assert {e["kind"] for e in ENTRIES} == {"ati_daq", "ati_net_ft", "ati_serial"}
