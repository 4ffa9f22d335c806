"""``rtctl log compare``: two runs beside each other."""

import enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.console import output, remark, say
from rtctl.cli.exit_codes import Exit
from rtctl.cli.log_files import logs_of
from rtctl.cli.options import JSON

if TYPE_CHECKING:
    from rtctl.comparison import Line


class By(enum.StrEnum):
    """How two runs are aligned."""

    AUTO = "auto"
    TICK = "tick"
    DEPTH = "depth"


RUN = Annotated[Path, typer.Argument(help="MCAP file of a run, or its folder.")]


def compare(
    one: RUN,
    other: RUN,
    by: Annotated[
        By, typer.Option(help="Align by tick or by depth of insertion; by depth where both have one.")
    ] = By.AUTO,
    json: JSON = False,
    picture: Annotated[
        Path | None, typer.Option(help="Draw the signals that differ most to this file, PNG or SVG.", dir_okay=False)
    ] = None,
) -> int:
    """Tell how far the signals of two runs are apart, where, and what was set differently.

    By depth, signals have bounds: what the drivers of the emulated bench and the plant may differ by. Exit code 6 if a signal is
    beyond its bound, or by tick if any signal differs at all.

    Example: `rtctl log compare runs/2026-01-31T10-00-00 runs/2026-01-31T11-00-00`
    """
    from rtctl import comparison
    from rtctl.log.reader import open_many

    logs = [open_many(logs_of([path])) for path in (one, other)]
    a, b = (log.controller for log in logs)
    if by is By.AUTO:
        by = By.DEPTH if comparison.has_insertion(a) and comparison.has_insertion(b) else By.TICK
    lines = (comparison.by_depth if by is By.DEPTH else comparison.by_tick)(a, b)
    different = comparison.set_differently(*logs)
    bad = [line for line in lines if not line.good]
    if json:
        say(_encoded(by, lines, different))
    else:
        if different:
            output().print(_settings(different))
        output().print(_table(by, lines if by is By.DEPTH else bad))
        say(f"{len(bad)} of {len(lines)} signals differ{' by more than they may' if by is By.DEPTH else ''}")
    if picture is not None:
        from rtctl.report.compared import draw

        draw(a, b, by.value, (str(one), str(other)), picture)
        remark(f"picture: {picture}")
    return Exit.DATA if bad else Exit.OK


def _table(by: By, lines: "list[Line]") -> Any:
    from rich.table import Table

    where = "at tick" if by is By.TICK else "at mm"
    heads = ("signal", "rms", "largest", where, "unit", *(("rms may be", "within") if by is By.DEPTH else ("unknown in one",)))  # fmt: skip
    table = Table(box=None, pad_edge=False)
    for head in heads:
        table.add_column(head, justify="left" if head in ("signal", "unit", "within") else "right")
    for line in lines:
        last = (f"{line.bound:g}", "yes" if line.good else "NO") if by is By.DEPTH else (str(line.unknown),)
        at = f"{line.where:.0f}" if by is By.TICK else f"{line.where:.2f}"
        table.add_row(line.signal, f"{line.rms:.4g}", f"{line.largest:.4g}", at, line.unit, *last)
    return table


def _settings(different: dict[str, tuple[Any, Any]]) -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, title="set differently", title_justify="left")
    for head in ("what", "one", "other"):
        table.add_column(head)
    for name, pair in different.items():
        table.add_row(name, *("absent" if v is None else str(v) for v in pair))
    return table


def _encoded(by: By, lines: "list[Line]", different: dict[str, tuple[Any, Any]]) -> str:
    from dataclasses import asdict
    from json import dumps

    signals = [{**asdict(line), "good": line.good} for line in lines]
    differing = {name: {"one": a, "other": b} for name, (a, b) in different.items()}
    return dumps({"by": by.value, "signals": signals, "set_differently": differing}, indent=2, ensure_ascii=False)
