"""What all calibrations do with their result: print it, and keep it in a dated file that is settings."""

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.console import say

if TYPE_CHECKING:
    from rtctl.settings import Settings

TO = Annotated[
    Path | None,
    typer.Option(
        help="File of the result; by default one with the day in its name. It must not exist.", dir_okay=False
    ),
]
SIM = Annotated[
    str | None,
    typer.Option("--sim", help="Calibrate the simulated bench of these settings, in lockstep.", metavar="CONFIG"),
]


def hash_of(file: Path) -> str:
    """Sixteen hex digits of a file's content, so that a result can be told to be that of a measurement."""
    import hashlib

    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def keep(
    what: str, settings: "Settings", to: Path | None, provenance: Mapping[str, Any], tables: Mapping[str, Any]
) -> None:
    """Keep the result of a robot's calibration as :func:`keep_as` does."""
    from rtctl.settings import config_hash

    robot = settings.robot
    origin = {"robot": f"{robot.name} ({robot.kind})", "settings": config_hash(settings)}
    keep_as(what, f"{robot.name}-{what}", to, origin | dict(provenance), tables)


def keep_as(what: str, stem: str, to: Path | None, provenance: Mapping[str, Any], tables: Mapping[str, Any]) -> None:
    """Write the result as a fragment of settings, and say how it is used.

    to: file; by default one named by `stem` and day. provenance: where it comes from, besides when and by what.
    """
    from importlib import metadata

    from rtctl.calibrate import fragment

    now = datetime.now().astimezone()
    path = to or Path(f"{stem}-{now:%Y-%m-%d}.toml")
    made = {"made": f"{now:%Y-%m-%d %H:%M %z} by rtctl {metadata.version('rtctl')}"}
    fragment.write(path, fragment.text(f"rtctl calibrate {what}", made | dict(provenance), tables))
    say(f"{path}: put it on top of your settings with --set @{path}")
