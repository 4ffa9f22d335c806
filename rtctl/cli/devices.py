"""``rtctl devices``: what is connected, and whether its wires are right."""

from typing import TYPE_CHECKING, Annotated

import typer

from rtctl.cli.bench import HIL
from rtctl.cli.console import output, say
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import JSON, SET, WATCH

if TYPE_CHECKING:
    from rich.table import Table

CONFIG = Annotated[str, typer.Argument(help="Settings of the target, or the name of a file that ships with rtctl.")]


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="Look at the devices of a backend of hardware; nothing moves.", no_args_is_help=True)
    group.command("list")(list_devices)
    group.command()(probe)
    app.add_typer(group, name="devices", rich_help_panel=WATCH)


def list_devices(config: CONFIG = HIL, overrides: SET = None, json: JSON = False) -> int:
    """Open every device, listen for a moment, and tell what it is, how old its samples are, and what went wrong.

    The daemon must not be running: a device has one owner. For emulated ones keep `rtctl bench rig` running.

    Example: `rtctl devices list my-target.toml`
    """
    import json as encoder
    from dataclasses import asdict

    from rtctl.hil.inspection import health
    from rtctl.settings import load

    settings = load(config, overrides or ())
    found = health(settings)
    if json:
        say(encoder.dumps({name: asdict(h) for name, h in found.items()}, indent=2, ensure_ascii=False))
        return Exit.OK
    kinds = {e["name"]: e["kind"] for e in settings.backend.options["devices"]}
    table = _table("device", "kind", "what it is", "firmware", "age", "errors")
    for name, h in found.items():
        age = "" if h.age_ticks >= 2**31 - 1 else f"{h.age_ticks} ticks"
        errors = ", ".join(f"{what} {count}" for what, count in h.errors.items() if count) or "none"
        table.add_row(name, kinds.get(name, ""), h.identity, h.firmware, age, errors)
    output().print(table)
    return Exit.OK


def probe(config: CONFIG = HIL, overrides: SET = None, json: JSON = False) -> int:
    """Check wiring and settings of every device without moving anything. Exit code 6 if something is not as it should be.

    Example: `rtctl devices probe my-target.toml`
    """
    import json as encoder
    from dataclasses import asdict

    from rtctl.hil.inspection import findings
    from rtctl.settings import load

    found = findings(load(config, overrides or ()))
    good = all(f.good for lines in found.values() for f in lines)
    if json:
        say(
            encoder.dumps(
                {name: [asdict(f) for f in lines] for name, lines in found.items()}, indent=2, ensure_ascii=False
            )
        )
    else:
        table = _table("device", "looked at", "found", "good", "what to do")
        for name, lines in found.items():
            for f in lines:
                table.add_row(name, f.what, f.found, "yes" if f.good else "NO", "" if f.good else f.remedy)
        output().print(table)
    return Exit.OK if good else Exit.DATA


def _table(*heads: str) -> "Table":
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for head in heads:
        table.add_column(head, overflow="fold")
    return table
