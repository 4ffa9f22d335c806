"""The load of a bus: the table of 07 section 2.4, and what is refused because of it."""

import pytest

from drivers.epos.load import BusLoad, plain_bits, stuffed_bits
from drivers.epos.options import read
from hal.device import Site
from hal.errors import OptionError
from hal.switchboard import Switchboard


def site(period_s=1e-3):
    return Site(period_s, 50, Switchboard())


@pytest.mark.parametrize(
    ("data_bytes", "plain", "stuffed"),
    [(0, 47, 55), (2, 63, 75), (4, 79, 95), (6, 95, 115), (7, 103, 125), (8, 111, 135)],
)
def test_bits_of_a_frame(data_bytes, plain, stuffed):
    assert (plain_bits(data_bytes), stuffed_bits(data_bytes)) == (plain, stuffed)


@pytest.mark.parametrize(
    ("mode", "axes", "divisor", "bits", "percent"),
    [
        ("csp", 5, 2, (997, 1205), (50, 60)),
        ("cst", 5, 2, (917, 1105), (46, 55)),
        ("csp", 3, 1, (617, 745), (62, 74)),
        ("csp", 2, 1, (427, 515), (43, 52)),
    ],
)
def test_load_of_the_layouts_that_fit(rig, mode, axes, divisor, bits, percent):
    table = rig.bus(*[rig.node(i + 1, i, mode) for i in range(axes)], divisor=divisor, heartbeat_ms=500)
    load = BusLoad.of(read("bus", table, site()), 1e-3)
    assert (load.plain_bits, load.stuffed_bits) == bits
    beats = 100 * (axes + 1) * 65 / 0.5 / 1e6
    assert 100 * load.plain == pytest.approx(percent[0], abs=0.6 + beats)
    assert 100 * load.worst == pytest.approx(percent[1], abs=0.6 + beats)


def test_heartbeats_are_part_of_the_load(rig):
    nodes = [rig.node(i + 1, i) for i in range(5)]
    slow, fast = (BusLoad.of(read("bus", rig.bus(*nodes, heartbeat_ms=ms), site()), 1e-3).worst for ms in (500, 5))
    assert fast - slow == pytest.approx(6 * 65 * (200 - 2) / 1e6)


@pytest.mark.parametrize(("mode", "axes", "percent"), [("csp", 5, 12), ("cst", 5, 11), ("csp", 4, 9)])
def test_a_layout_that_does_not_fit_is_refused_before_anything_is_sent(rig, mode, axes, percent):
    table = rig.bus(*[rig.node(i + 1, i, mode) for i in range(axes)], divisor=1)
    with pytest.raises(OptionError, match=rf"cannot carry.*{percent}\d % load.*80 %.*raise the divisor") as refused:
        read("bus", table, site())
    assert "second bus" in str(refused.value)


def test_a_slow_bus_carries_less(rig):
    with pytest.raises(OptionError, match="cannot carry"):
        read("bus", rig.bus(*[rig.node(i + 1, i) for i in range(3)], bitrate=250_000), site())
