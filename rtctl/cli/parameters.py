"""``rtctl param``: options of a running controller."""

import tomllib
from textwrap import shorten
from typing import Annotated, Any

import typer

from rtctl.cli.connection import connect
from rtctl.cli.console import output, say, to_toml
from rtctl.cli.options import DEFAULT_ENDPOINT, DEFAULT_ROBOT, ENDPOINT, JSON, ROBOT, SETTINGS

LONGEST_VALUE = 200
"""In the list [letters]; `param get` has the rest."""


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="Options of a running controller.", no_args_is_help=True)
    group.command(name="get")(get)
    group.command(name="set")(set_values)
    group.command(name="list")(list_all)
    app.add_typer(group, name="param", rich_help_panel=SETTINGS)


def get(
    names: Annotated[list[str], typer.Argument(help="Dotted names.")],
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
    json: JSON = False,
) -> None:
    """Print the values in force.

    Example: `rtctl param get admittance.lateral safety.force_limit_n`
    """
    import json as encoder

    with connect(robot, endpoint) as client:
        values = client.parameters(*names)
    if json:
        say(encoder.dumps(values, indent=2, ensure_ascii=False))
    else:
        for name, value in values.items():
            say(f"{name} = {to_toml(value)}")


def set_values(
    assignments: Annotated[
        list[str], typer.Argument(help="One or more, taken together or not at all.", metavar="NAME=VALUE...")
    ],
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
) -> None:
    """Change live options while the controller runs: checked together, in force from one tick on.

    Example: `rtctl param set admittance.lateral=false wrench.cutoff_hz=10`
    """
    values = dict(assignment(text) for text in assignments)
    with connect(robot, endpoint) as client:
        reply = client.set_parameters(values)
    say(f"parameter set {reply.result.get('number')} is in force from tick {reply.tick}")


def list_all(
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
    live: Annotated[bool, typer.Option("--live", help="Only those that can be changed now.")] = False,
    json: JSON = False,
) -> None:
    """List every option: value, bounds, meaning, and whether it can be changed while the controller runs.

    Example: `rtctl param list --live`
    """
    import json as encoder

    with connect(robot, endpoint) as client:
        reference = client.parameter_reference()
    shown = {name: entry for name, entry in reference.items() if entry["live"] or not live}
    if json:
        say(encoder.dumps(shown, indent=2, ensure_ascii=False))
        return
    from rich.table import Table
    from rich.text import Text

    table = Table("option", "value", "bounds", "live", "meaning", box=None, header_style="dim", pad_edge=False)
    for name, entry in shown.items():
        bounds = entry["bound"] or (f"[{entry['unit']}]" if entry["unit"] else "")
        value = shorten(to_toml(entry["value"]), LONGEST_VALUE, placeholder=" …")
        cells = (name, value, bounds, "yes" if entry["live"] else "", entry["doc"])
        table.add_row(*map(Text, cells))
    output().print(table)


def assignment(text: str) -> tuple[str, Any]:
    """Name and value of ``name=value``, the value as in TOML; bare words are texts.

    Raises:
        OptionError: there is no name or no value.
    """
    from hal.errors import OptionError

    name, sign, value = (part.strip() for part in text.partition("="))
    if not (name and sign and value):
        raise OptionError("a change must read NAME=VALUE", value=text, remedy="for instance wrench.cutoff_hz=10")
    try:
        return name, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return name, value
