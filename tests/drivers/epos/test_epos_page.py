"""The page says what the code does: every setting with its bounds, every load, and an example that reads."""

import re
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from drivers.epos.load import BusLoad
from drivers.epos.options import HIGHEST_LOAD, EposOptions, NodeOptions, read
from hal.device import Site
from hal.options import bound_text, describe
from hal.switchboard import Switchboard

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "how-to" / "wire-epos-drives.md").read_text()


@pytest.mark.parametrize("options", [EposOptions, NodeOptions])
def test_every_setting_is_on_the_page_with_its_bounds(options):
    for path, _, field in describe(options):
        (row,) = re.findall(rf"^\| `{path}` \|.*$", PAGE, re.MULTILINE)
        assert bound_text(field).replace("|", "\\|") in row
        assert field.metadata["doc"] in row


def test_every_load_is_as_computed():
    rows = re.findall(r"^\| (\d) \| (\w+) \| (\d) \| (\d+) – (\d+) \| (\d+) – (\d+) % \| (\w+) \|$", PAGE, re.MULTILINE)
    assert len(rows) == 7
    for axes, mode, divisor, plain, stuffed, low, high, accepted in rows:
        nodes = [SimpleNamespace(mode=mode)] * int(axes)
        bus = SimpleNamespace(nodes=nodes, divisor=int(divisor), heartbeat_ms=20, bitrate=1_000_000)
        load = BusLoad.of(bus, 1e-3)
        assert (load.plain_bits, load.stuffed_bits) == (int(plain), int(stuffed))
        assert (round(100 * load.plain), round(100 * load.worst)) == (int(low), int(high))
        assert (accepted == "yes") == (load.worst <= HIGHEST_LOAD)


def test_the_example_reads():
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (table,) = tomllib.loads(example)["backend"]["options"]["devices"]
    assert (table.pop("kind"), table.pop("name")) == ("epos_bus", "arm")
    assert len(read("arm", table, Site(1e-3, 50, Switchboard())).nodes) == 1
