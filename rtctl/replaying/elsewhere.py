"""The part of a comparison that runs in another revision: a program, whose imports are those of that revision.

    python -P elsewhere.py FOLDER

FOLDER holds ``rows.npy`` (inputs, of whatever layout) and ``job.json``; it gets ``replayed.npy`` and ``told.json``.
Nothing of this file's own revision is imported, and only what revisions have had since there are replays is used.
"""

import base64
import dataclasses
import json
import sys
import typing
from pathlib import Path
from typing import Any

import numpy as np

Staged = dict[str, dict[int, bytes]]


class Unreadable(Exception):
    """This revision cannot do what is asked for, and why."""


def main(folder: Path) -> None:
    """Replay the inputs with this revision's controller."""
    job = json.loads((folder / "job.json").read_text())
    rows = np.load(folder / "rows.npy")
    from hal import kernel
    from rtctl import replay
    from rtctl.controller import Controller
    from rtctl.parameters import pack
    from rtctl.settings import Settings, from_table

    if not Path(kernel.__file__).is_relative_to(job["revision_folder"]):
        raise Unreadable(
            f"the interpreter finds rtctl in {Path(kernel.__file__).parents[1]}, not in the other revision"
        )
    table = known(Settings, job["settings"], job["chosen"])
    controller = Controller(from_table(table))
    staged = {
        name: {int(m["number"]): base64.b64decode(m["record_base64"]) for m in job[name]}
        for name in ("staged_plan", "staged_parameters")
    }
    size = controller.memory["staged_parameters"].dtype.itemsize
    for m in job["staged_parameters"]:  # of another layout: packed anew from its values
        number = int(m["number"])
        if len(staged["staged_parameters"][number]) != size and "settings" in m:
            settings = from_table(known(Settings, m["settings"], job["chosen"]))
            staged["staged_parameters"][number] = pack(settings, controller.robot, number).tobytes()
    replayed = rerun(replay, controller, as_here(rows, controller.table.dtype), staged)
    np.save(folder / "replayed.npy", replayed)
    told = {
        "kernel_hash": kernel.kernel_hash(),
        "kernel_sources": [str(p.relative_to(kernel.ROOT)) for p in kernel.kernel_sources()],
    }
    (folder / "told.json").write_text(json.dumps(told))


def known(cls: type, table: dict[str, Any], chosen: dict[str, Any], where: str = "") -> dict[str, Any]:
    """`table` without options that this revision does not have yet; those that were `chosen` cannot be left out."""
    fields = {f.name for f in dataclasses.fields(cls)}
    hints = typing.get_type_hints(cls)
    kept = {}
    for name, value in table.items():
        path = f"{where}{name}"
        if name in fields:
            nested = dataclasses.is_dataclass(hints[name]) and isinstance(value, dict)
            kept[name] = known(hints[name], value, chosen.get(name, {}), f"{path}.") if nested else value
        elif name in chosen:
            raise Unreadable(f"it does not know the setting {path}, which this run has")
    return kept


def as_here(rows: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Rows (n,) in this revision's layout."""
    from rtctl import record

    needed = record.INPUTS - getattr(record, "ZERO_BEFORE", frozenset())
    lacking = [n for n in sorted(needed) if n not in (rows.dtype.names or ()) or rows.dtype[n] != dtype[n]]
    if lacking:
        raise Unreadable(f"it reads inputs that the log lacks: {', '.join(lacking)}")
    fed = np.zeros(len(rows), dtype)
    for name in dtype.names or ():
        if name in (rows.dtype.names or ()) and rows.dtype[name] == dtype[name]:
            fed[name] = rows[name]
    return fed


def rerun(replay: Any, controller: Any, rows: np.ndarray, staged: Staged) -> np.ndarray:
    """The records (n,) that this revision's controller makes of the inputs in `rows` (n,)."""
    if hasattr(replay, "rerun"):
        return replay.rerun(controller, rows, staged)
    replayed = np.zeros_like(rows)  # a revision from before there was such a function
    memory = controller.memory, controller.sensors, controller.actuators
    begin = 0
    for at in [*np.flatnonzero(rows["command_verb"]).tolist(), len(rows)]:
        if at > begin:
            replay.run_rows(rows[begin:at], replayed[begin:at], *memory)
        if at < len(rows):
            replay._prepare(controller, rows[at], staged)
            replay.run_rows(rows[at : at + 1], replayed[at : at + 1], *memory)
        begin = at + 1
    return replayed


if __name__ == "__main__":
    place = Path(sys.argv[1])
    try:
        main(place)
    except Exception as error:  # whatever an old revision stumbles over is the answer
        why = str(error) if isinstance(error, Unreadable) else f"{type(error).__name__}: {error}"
        (place / "refused.txt").write_text(why)
        sys.exit(1)
