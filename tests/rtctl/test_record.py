"""The one record: its layout is what numpy, CDR and the message text all say."""

import re

import numpy as np
import pytest

from hal.signals import ROS_TYPES
from rtctl.log.hashing import output_fields
from rtctl.record import INPUTS, TIMING, controller_table

TABLES = [controller_table(dof) for dof in (3, 5, 6)]
ids = [f"{dof} dof" for dof in (3, 5, 6)]
NUMPY_OF = {ros: code for code, ros in ROS_TYPES.items()}


@pytest.mark.parametrize("table", TABLES, ids=ids)
def test_every_field_is_naturally_aligned_and_rows_follow_each_other_without_gaps(table):
    dtype, at = table.dtype, 0
    for name in dtype.names:
        field, offset = dtype.fields[name][:2]
        assert offset == at, f"no hidden padding before {name}"
        assert offset % field.base.alignment == 0
        at += field.itemsize
    assert at == dtype.itemsize
    assert dtype.itemsize % 8 == 0
    assert dtype == np.dtype([(n, dtype[n]) for n in dtype.names], align=True), "a compiler would lay it out alike"


@pytest.mark.parametrize("table", TABLES, ids=ids)
def test_the_row_is_a_cdr_body(table):
    """CDR aligns every primitive to its size, counted from the start of the body; fixed arrays have no prefix."""
    at = 0
    for name in table.dtype.names:
        field, offset = table.dtype.fields[name][:2]
        size = field.base.itemsize
        at += -at % size
        assert offset == at
        at += field.itemsize
    assert at == table.dtype.itemsize


@pytest.mark.parametrize("table", TABLES, ids=ids)
def test_the_message_text_describes_the_row(table):
    fields = []
    for line in table.message.splitlines():
        match = re.fullmatch(r"(\w+?)(?:\[(\d+)\])? (\w+)(  # .+)?", line)
        assert match, line
        kind, count, name, comment = match.groups()
        assert comment or name == "reserved", name
        fields.append((name, NUMPY_OF[kind], (int(count),)) if count else (name, NUMPY_OF[kind]))
    assert np.dtype(fields) == table.dtype


@pytest.mark.parametrize("table", TABLES, ids=ids)
def test_every_signal_is_documented_and_units_agree_with_names(table):
    units = {"_mm": "mm", "_rad": "rad", "_n": "N", "_v": "V", "_ns": "ns", "_ticks": "ticks", "_mm_per_s": "mm/s"}
    for s in table.signals:
        assert s.meaning, s.name
        for suffix, unit in units.items():
            if s.name.endswith(suffix):
                assert s.unit == unit, s.name


@pytest.mark.parametrize("table", TABLES, ids=ids)
def test_inputs_timing_and_outputs_share_out_the_record(table):
    names = set(table.dtype.names)
    assert names >= INPUTS | TIMING
    assert not INPUTS & TIMING
    outputs = set(output_fields(table.dtype))
    assert outputs == names - INPUTS - TIMING - {"reserved"}
    assert {"command_applied_v", "command_desired_v", "pose_reference", "operating_state"} <= outputs


def test_time_comes_first():
    assert TABLES[0].dtype.names[:2] == ("time_ns", "tick")
