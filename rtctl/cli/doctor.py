"""``rtctl doctor``: what this machine is for a real-time loop."""

from typing import TYPE_CHECKING

import typer

from rtctl.cli.console import output, say
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import CONFIG, DEFAULT_CONFIG, JSON, RUN, SET

if TYPE_CHECKING:
    from rtctl.readiness.doctor import Diagnosis


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command(rich_help_panel=RUN)(doctor)


def doctor(config: CONFIG = DEFAULT_CONFIG, overrides: SET = None, json: JSON = False) -> int:
    """Look at the machine as the loop of these settings would find it, and say what to mend; nothing is changed.

    Exit code 0 if the daemon will obtain the grade `rt`, else 1.

    Example: `rtctl doctor planar-sim`
    """
    import json as encoder
    from dataclasses import asdict

    from rtctl.exchange.control import Grade
    from rtctl.readiness.doctor import examine
    from rtctl.settings import load

    diagnosis = examine(load(config, overrides or ()))
    if json:
        document = {"grade": _name(diagnosis), "core": diagnosis.core, "findings": [asdict(f) for f in diagnosis.findings]}  # fmt: skip
        say(encoder.dumps(document, indent=2, ensure_ascii=False))
    else:
        _tell(diagnosis)
    return Exit.OK if diagnosis.grade == Grade.RT else Exit.FAILED


def _name(diagnosis: "Diagnosis") -> str:
    return diagnosis.grade.name.lower().replace("_", "-")


def _tell(diagnosis: "Diagnosis") -> None:
    from rich.table import Table

    from rtctl.readiness.doctor import OBTAINED
    from rtctl.readiness.finding import Verdict

    table = Table(title=f"this machine, for a loop on core {diagnosis.core}", title_justify="left")
    for head in ("", "what", "found", "what it costs", "mend it with"):
        table.add_column(head, overflow="fold")
    marks = {Verdict.GOOD: "good", Verdict.COSTS: "COSTS", Verdict.UNKNOWN: "?"}
    for f in diagnosis.findings:
        table.add_row(marks[f.verdict], f.name, f.found, f.cost, f.remedy)
    output().print(table)
    missing = [name.removeprefix(OBTAINED) for name in diagnosis.missing]
    say(f"grade: {_name(diagnosis)}" + (f", for want of: {', '.join(missing)}" if missing else ""))
