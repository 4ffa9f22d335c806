"""``rtctl replay --against`` and ``--bisect``: what they print."""

from dataclasses import asdict
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rtctl.cli.console import output, remark, say, say_error
from rtctl.cli.exit_codes import Exit

if TYPE_CHECKING:
    from rtctl.replaying.against import Comparison

SHOWN = 15
"""Signals in the table of growth; those that differ first."""


def compare(paths: list[Path], against: str, json: bool) -> Exit:
    """Compare this version with a revision, or the two of A..B, on a log; 0 if identical, else 6."""
    from rtctl.log.reader import open_many
    from rtctl.replaying import against as comparisons
    from rtctl.replaying.revisions import revisions

    log = open_many(paths)
    first, dots, second = against.partition("..")
    with revisions() as clone:
        one = clone.resolve(first)
        other = clone.resolve(second or "HEAD") if dots else None
        names = clone.subject(one), "this version" if other is None else clone.subject(other)
        remark(f"running {names[0]}; its kernels are compiled, which takes a minute")
        theirs = clone.outputs(one, log).rows
        ours = comparisons.here(log) if other is None else clone.outputs(other, log).rows
    found = comparisons.compare(theirs, ours)
    if json:
        say(dumps({"one": names[0], "other": names[1], "identical": found.tick is None, **_plain(found)}, indent=2))
    else:
        _tell(found, *names)
    return Exit.OK if found.tick is None else Exit.DATA


def bisect(paths: list[Path], wanted: str, json: bool) -> Exit:
    """Find the first commit after GOOD (up to HEAD, or B of A..B) whose outputs differ; 0 if none do, else 6."""
    from rtctl.log.reader import open_many
    from rtctl.replaying import against as comparisons
    from rtctl.replaying.revisions import revisions

    log = open_many(paths)
    first, _, second = wanted.partition("..")
    with revisions() as clone:
        good, bad = clone.resolve(first), clone.resolve(second or "HEAD")
        found = comparisons.bisect(clone, log, good, bad, remark)
        subject = None if found.commit is None else clone.subject(found.commit)
        ends = clone.subject(good), clone.subject(bad)
    if json:
        facts = {"commit": found.commit, "subject": subject, "candidates": found.candidates, "judged": found.judged}
        say(dumps({**facts, **_plain(found.comparison)}, indent=2))
    elif found.comparison.tick is None:
        say(f"identical: {found.comparison.ticks} ticks, from {ends[0]} to {ends[1]}")
    else:
        _tell(found.comparison, *ends)
        say(f"first commit whose outputs differ: {subject or 'none of those that touch a kernel'}; {found.judged} revisions were run for {found.candidates} candidates")  # fmt: skip
    return Exit.OK if found.comparison.tick is None else Exit.DATA


def _tell(found: "Comparison", one: str, other: str) -> None:
    from rich.table import Table

    if found.not_compared:
        remark(f"not compared, only one has them: {', '.join(found.not_compared)}")
    if found.tick is None:
        say(f"identical: {found.ticks} ticks, {one} and {other}")
        return
    assert found.values is not None
    say_error(f"{one} and {other} differ: first in tick {found.tick}, signal {found.signal}: {found.values[0]} and {found.values[1]}")  # fmt: skip
    table = Table(box=None, pad_edge=False, title="largest difference, so many ticks after the first one", title_justify="left")  # fmt: skip
    later = list(found.growth[0].largest)
    for head in ("stage", "signal", "from tick", *(f"+{n}" for n in later)):
        table.add_column(head, justify="left" if head in ("stage", "signal") else "right")
    for g in found.growth[:SHOWN]:
        reached = ["" if g.largest[n] is None else f"{g.largest[n]:.3g}" for n in later]
        table.add_row(g.stage, g.signal, str(g.first_tick), *reached)
    output().print(table)
    if len(found.growth) > SHOWN:
        say(f"and {len(found.growth) - SHOWN} signals that differ later")


def _plain(found: "Comparison") -> dict[str, Any]:
    table = asdict(found)
    del table["row"]
    for growth in table["growth"]:  # JSON has no infinity
        growth["largest"] = {
            n: v if v is None or v != float("inf") else "infinite" for n, v in growth["largest"].items()
        }
    return table
