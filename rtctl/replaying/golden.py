"""Golden logs: all that a replay feeds, and of every output a fingerprint, so that the log of a run fits a repository.

A change of arithmetic anywhere in the controller shows as the first tick and signal that no longer comes out. The values
that are gone come back from the revision in the header: ``rtctl replay GOLDEN --against REVISION``.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from hal.errors import RtctlError
from hal.signals import SIZES, Signal, Table
from rtctl.log.format import CONTROLLER, PARAMETERS, PLANS
from rtctl.log.hashing import output_fields
from rtctl.log.reader import open_many
from rtctl.log.writer import LogWriter
from rtctl.record import controller_table
from rtctl.replay import whole_rows
from rtctl.replaying.fingerprint import PREFIX, fingerprints
from rtctl.rerun import NEEDED

CHUNK_BYTES = 8 * 1024 * 1024
"""One chunk compresses best."""


def golden_table(dof: int) -> Table:
    """The row of a golden log of a robot with `dof` pose coordinates."""
    whole = controller_table(dof)
    kept = [s for s in whole.signals if s.name in NEEDED]
    marks = [
        Signal(PREFIX + name, "u1", (), "", f"stands for the bytes of {name}")
        for name in output_fields(whole.dtype)
        if name not in NEEDED
    ]
    return Table("Controller", tuple(sorted([*kept, *marks], key=lambda s: -SIZES[s.type])))


def condense(paths: Iterable[str | Path], target: Path) -> int:
    """Write the golden log `target` of the run in the log files at `paths`; returns its size in bytes.

    Raises:
        LogError: a log cannot be read, or the target exists.
        RtctlError: ticks are missing, or the run is of another version of rtctl.
    """
    log = open_many(paths)
    rows = whole_rows(log)
    table = golden_table(rows["pose_measured"].shape[1])
    if rows.dtype != controller_table(rows["pose_measured"].shape[1]).dtype:
        raise RtctlError("the log is of another version of rtctl", remedy="condense it with the revision in its header")
    golden = np.zeros(len(rows), table.dtype)
    for name in table.dtype.names or ():
        if name in NEEDED:
            golden[name] = rows[name]
        elif name.startswith(PREFIX):
            golden[name] = fingerprints(rows[name.removeprefix(PREFIX)])
    with LogWriter(target, {CONTROLLER: table}, log.header, chunk_bytes=CHUNK_BYTES, message_index=False) as writer:
        for topic, documents in ((PARAMETERS, log.parameters), (PLANS, log.plans)):
            for d in documents:
                writer.write_json(topic, 0, {k: d[k] for k in ("number", "values", "record_base64") if k in d})
        writer.write_rows(CONTROLLER, golden)
    return target.stat().st_size
