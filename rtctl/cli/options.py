"""Options and arguments that several commands share."""

from typing import Annotated

import typer

CONFIG = Annotated[str, typer.Argument(help="Settings file, or the name of one that ships with rtctl.")]
SET = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="Override one setting, or those in a TOML file, as @FILE; may be repeated.", metavar="KEY=VALUE"
    ),
]
SEED = Annotated[int, typer.Option(help="Seed of the simulation: noise, and scatter where it is on.", min=0)]
ROBOT = Annotated[str, typer.Option(help="Name of the robot in every key.", envvar="RTCTL_ROBOT")]
ENDPOINT = Annotated[str, typer.Option(help="Where its gateway listens.", envvar="RTCTL_ENDPOINT")]
JSON = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]

DEFAULT_CONFIG = "planar-sim"
DEFAULT_ROBOT = "planar"
DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"

RUN, WATCH, OPERATE, RECORDS, SETTINGS = "Run", "Watch", "Operate", "Records", "Settings"
"""Headings of the commands in the help."""

NUMBERS = {"ignore_unknown_options": True}
"""Context settings of commands with numbers as arguments: a negative one is not an option."""
