"""Settings that do not fit together are refused with what to do."""

import pytest

from drivers.epos.options import read
from hal.device import Site
from hal.errors import OptionError
from hal.switchboard import Switchboard

SITE = Site(1e-3, 50, Switchboard())


def test_the_defaults_read(rig):
    found = read("bus", rig.bus(rig.node(1, 0)), SITE)
    assert (found.divisor, found.bitrate, found.interface, found.nodes[0].mode) == (2, 1_000_000, "socketcan", "cst")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"mode": "csp", "generation": "epos2"}, "none of epos2"),
        ({"mode": "current", "generation": "epos4"}, "none of epos4"),
        ({"gain_a_per_v": None}, "takes gain_a_per_v"),
        ({"gain_rad_per_s_per_v": 1.0}, "takes gain_a_per_v and not gain_rad_per_s_per_v"),
        ({"direction": 0}, r"direction is out of bounds.*1 \| -1"),
        ({"current_limit_a": 9.0}, "too far above the nominal current"),
        ({"position_limits_rad": [1.0, -1.0]}, "the lower first"),
        ({"position_limits_rad": [1.0]}, "two numbers"),
        ({"current_limit_object": [0x3001]}, "index and sub-index"),
        ({"current_limit_object": [0x3001, 256]}, "index and sub-index"),
        ({"objects": [[0x3001, 1, 3, 5]]}, "no object holds this"),
        ({"objects": [[0x3001, 1, 4, 0.5]]}, "no object holds this"),
        ({"objects": [[0x3001, 1, 1, 256]]}, "no object holds this"),
        ({"objects": [[0x3001, 1, 2, -32769]]}, "no object holds this"),
        ({"objects": [[0x13001, 1, 2, 0]]}, "no object holds this"),
        ({"node": 127}, "1 .. 126"),
        ({"counts_per_turn": 4000}, "unknown key"),
    ],
)
def test_a_drive_that_does_not_fit_together(rig, change, said):
    table = {k: v for k, v in {**rig.node(1, 0), **change}.items() if v is not None}
    with pytest.raises(OptionError, match=said):
        read("bus", rig.bus(table), SITE)


def test_nodes_and_axes_are_there_once(rig):
    with pytest.raises(OptionError, match="every node"):
        read("bus", rig.bus(rig.node(1, 0), rig.node(1, 1)), SITE)
    with pytest.raises(OptionError, match="every axis"):
        read("bus", rig.bus(rig.node(1, 0), rig.node(2, 0)), SITE)
    with pytest.raises(OptionError, match="every node"):
        read("bus", rig.bus(rig.node(7, 0), master=7), SITE)


def test_a_bus_without_drives(rig):
    with pytest.raises(OptionError, match="nodes must be a list of tables"):
        read("bus", rig.bus(), SITE)


def test_interpolation_is_over_whole_milliseconds(rig):
    with pytest.raises(OptionError, match="whole milliseconds"):
        read("bus", rig.bus(rig.node(1, 0, "csp"), divisor=1), Site(0.0005, 50, Switchboard()))
    read("bus", rig.bus(rig.node(1, 0, "csp"), divisor=2), Site(0.0005, 50, Switchboard()))
