"""``rtctl calibrate``: the group; every calibration is in a module beside this one."""

import typer

from rtctl.cli import calibrate_array, calibrate_backlash, calibrate_gravity, calibrate_saline, calibrate_stiffness
from rtctl.cli.options import SETTINGS


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="Calibrate sensor, robot and array; results are settings.", no_args_is_help=True)
    for family in (calibrate_gravity, calibrate_backlash, calibrate_stiffness, calibrate_array, calibrate_saline):
        family.add_to(group)
    app.add_typer(group, name="calibrate", rich_help_panel=SETTINGS)
