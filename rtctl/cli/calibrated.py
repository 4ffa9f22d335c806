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
    typer.Option(help="File of the result; by default one named by robot and day. It must not exist.", dir_okay=False),
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
    """Write the result as a fragment of settings, and say how it is used."""
    from rtctl.calibrate import fragment
    from rtctl.settings import config_hash

    now = datetime.now().astimezone()
    path = to or Path(f"{settings.robot.name}-{what}-{now:%Y-%m-%d}.toml")
    origin = {
        "made": f"{now:%Y-%m-%d %H:%M %z}",
        "robot": f"{settings.robot.name} ({settings.robot.kind})",
        "settings": config_hash(settings),
    }
    fragment.write(path, fragment.text(f"rtctl calibrate {what}", origin | dict(provenance), tables))
    say(f"{path}: put it on top of your settings with --set @{path}")
