"""``rtctl log blackbox``: who held the loop, and the ticks around it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.console import output, say
from rtctl.cli.exit_codes import Exit
from rtctl.cli.log_files import logs_of
from rtctl.cli.options import JSON
from rtctl.stages import STAGES

if TYPE_CHECKING:
    from rich.table import Table

FILES = Annotated[list[Path], typer.Argument(help="MCAP files of one run, in order, or its folder.")]
HEADS = ("tick", "", "missed", "late", "took", *(s.name for s in STAGES), "faults", "slept", "displaced", "core")


def blackbox(
    files: FILES,
    tick: Annotated[int | None, typer.Option(help="Only the box of this tick.", min=0)] = None,
    around: Annotated[int, typer.Option(help="Ticks shown before and after it.", min=0, max=50)] = 4,
    json: JSON = False,
) -> int:
    """Tell who held the loop in each tick over budget and before each fault, with the ticks around it.

    Times are in µs; `record` is that of the tick before. A tick marked with > is the one in question, * others over budget.

    Example: `rtctl log blackbox runs/2026-01-31T10-00-00`
    """
    import json as encoder

    from rtctl.log.reader import LogError, open_many

    boxes = open_many(logs_of(files)).blackboxes
    if tick is not None:
        known = [box["tick"] for box in boxes]
        boxes = [box for box in boxes if box["tick"] == tick]
        if not boxes:
            listed = ", ".join(map(str, known)) or "none: no tick of the run was over budget"
            raise LogError("this tick has no black box", value=tick, bound=listed)
    if json:
        say(encoder.dumps(boxes, ensure_ascii=False))
        return Exit.OK
    for box in boxes:
        say(f"{box['reason']}: {box['text']}")
        if box["remedy"]:
            say(f"  what to do: {box['remedy']}")
        output().print(_table(box, around))
        say()
    if not boxes:
        say("no black box: no tick was over budget, and there was no fault")
    return Exit.OK


def _table(box: dict[str, Any], around: int) -> "Table":
    """The ticks around the one in question, or around the one that was judged in its place."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for head in HEADS:
        table.add_column(head, justify="right")
    rows = box["rows"]
    middle = rows["tick"].index(box["tick"])
    for i in range(max(0, middle - around), min(len(rows["tick"]), middle + around + 1)):
        at = rows["tick"][i]
        mark = ">" if i == middle else "*" if at in box["over_budget"] else ""
        times = [rows["lateness_ns"][i], rows["tick_ns"][i], *rows["stage_ns"][i]]
        faults = rows["minor_faults"][i] + rows["major_faults"][i]
        counts = [faults, rows["voluntary_switches"][i], rows["involuntary_switches"][i], rows["core"][i]]
        table.add_row(
            str(at), mark, str(rows["missed_ticks"][i]), *(f"{t * 1e-3:.1f}" for t in times), *map(str, counts)
        )
    return table
