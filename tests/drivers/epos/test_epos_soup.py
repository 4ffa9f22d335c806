"""Frames that nobody should send: the driver never raises, and calls nothing valid that is not."""

import can
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.frames import VALID

IDENTIFIERS = st.sampled_from([0x000, 0x080, 0x081, 0x082, 0x181, 0x182, 0x201, 0x281, 0x581, 0x701, 0x702, 0x77F, 0x7FF])  # fmt: skip


@st.composite
def frames(draw):
    return can.Message(
        arbitration_id=draw(IDENTIFIERS | st.integers(0, 0x7FF)),
        is_extended_id=draw(st.booleans()),
        is_remote_frame=draw(st.booleans()),
        is_error_frame=draw(st.booleans()),
        data=draw(st.binary(max_size=8)),
    )


@settings(max_examples=40)
@given(soup=st.lists(frames(), max_size=60), power=st.booleans())
def test_byte_soup(rig, soup, power):
    r = rig.make(rig.bus(rig.node(1, 0), rig.node(2, 1, "csp")))
    r.power_up()
    for message in soup:
        r.emulator.bus._incoming.append(message)
        s = r.step(1.0, int(power))
        if s["axes_validity"] == VALID:
            assert np.isfinite(s["axis_angle_rad"]).all()
        else:
            assert np.isnan(s["axis_angle_rad"]).all()
    r.device.health()
    r.backend.close()


def test_frames_of_the_wrong_kind_are_counted_and_not_believed(rig):
    r = rig.make(rig.bus(rig.node(1, 0)))
    before = r.run(20, power=0)["axis_angle_rad"].copy()
    for message in (
        can.Message(arbitration_id=0x181, is_extended_id=False, data=bytes(5)),
        can.Message(arbitration_id=0x181, is_extended_id=True, data=b"\x37\x12\xff\xff\xff\x7f"),
        can.Message(arbitration_id=0x181, is_extended_id=False, is_remote_frame=True, dlc=6),
        can.Message(arbitration_id=0x701, is_extended_id=False, data=bytes(2)),
        can.Message(arbitration_id=0x081, is_extended_id=False, data=bytes(3)),
    ):
        r.emulator.bus._incoming.append(message)
    s = r.step(power=0)
    assert s["trouble"] == 0
    assert s["axis_angle_rad"] == before
    assert r.device.health().errors["malformed"] == 5
