"""``rtctl calibrate backlash`` and ``rtctl calibrate record``: the wire drives from tracked poses."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rtctl.cli.calibrated import TO, hash_of, keep
from rtctl.cli.console import output, say
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import CONFIG, DEFAULT_CONFIG, SEED, SET
from rtctl.cli.progress import shown

if TYPE_CHECKING:
    from rich.table import Table

    from rtctl.calibrate.transmission import LegFit


def add_to(group: typer.Typer) -> None:
    """Add the commands."""
    group.command()(record)
    group.command()(backlash)


def record(
    file: Annotated[Path, typer.Argument(help="CSV file to write; it must not exist.")],
    config: CONFIG = DEFAULT_CONFIG,
    poses: Annotated[int, typer.Option(help="How many poses.", min=8, max=1000)] = 300,
    noise_mm: Annotated[float, typer.Option(help="Noise of the tracker's positions, rms.", min=0.0, max=5.0)] = 0.0,
    noise_rad: Annotated[float, typer.Option(help="Noise of its angles, rms.", min=0.0, max=0.1)] = 0.0,
    seed: SEED = 0,
    overrides: SET = None,
) -> int:
    """Drive a simulated robot through its workspace, and note motor angles and what a tracker would see.

    On a real robot the tracker writes such a file: see the how-to on calibrating the robot.

    Example: `rtctl calibrate record poses.csv planar-sim --poses 100 --noise-mm 0.03`
    """
    from rtctl.calibrate import tracked_poses
    from rtctl.calibrate.simulated import SimulatedRobot
    from rtctl.calibrate.transmission_run import poses_to_track, track
    from rtctl.settings import config_hash, load

    settings = load(config, overrides or ())
    simulated = SimulatedRobot(settings, seed)
    chosen = poses_to_track(simulated.robot, poses)
    with shown() as progress:
        tracked = track(simulated, chosen, progress, (noise_mm, noise_rad), seed)
    simulated.close()
    comments = (
        f"robot {settings.robot.name} ({simulated.robot.kind}), simulated with seed {seed}, settings {config_hash(settings)}",
        f"tracker noise {noise_mm:g} mm, {noise_rad:g} rad",
    )
    tracked_poses.write(file, simulated.robot, tracked, comments)
    say(f"{file}: {poses} poses")
    return Exit.OK


def backlash(
    file: Annotated[Path, typer.Argument(help="CSV file of tracked poses.")],
    config: CONFIG = DEFAULT_CONFIG,
    bound: Annotated[float, typer.Option(help="Largest residual of a leg [rad rms].", min=0.001, max=100.0)] = 0.6,
    to: TO = None,
    overrides: SET = None,
) -> int:
    """Find screw leads, pulley radii and backlash of the wire drives from tracked poses. The result is a file of settings.

    Example: `rtctl calibrate backlash poses.csv planar-sim`
    """
    from rtctl import robots
    from rtctl.calibrate import tracked_poses, transmission
    from rtctl.settings import load

    settings = load(config, overrides or ())
    robot = robots.load(settings.robot.kind, settings.robot.geometry)
    tracked = tracked_poses.read(file, robot)
    legs = transmission.fit_legs(robot, tracked.pose, tracked.motor_rad, tracked.extending)
    output().print(_figures(legs))
    transmission.require(legs, bound)
    others = settings.control.backlash_rad[len(legs) :]
    tables = {
        "control": {"backlash_rad": [*(round(max(leg.backlash_rad, 0.0), 4) for leg in legs), *others]},
        "robot.geometry": {
            "eta_mm_per_rad": [round(leg.eta_mm_per_rad, 7) for leg in legs],
            "pulley_radius_mm": [round(leg.pulley_radius_mm, 4) for leg in legs],
        },
    }
    provenance = {
        "from": f"{file}, sha256 {hash_of(file)}, {len(tracked.pose)} poses",
        "residual of the legs": f"{', '.join(f'{leg.residual_rad:.3f}' for leg in legs)} rad rms",
        "standard deviation of the backlash": f"{', '.join(f'{leg.backlash_sd_rad:.3f}' for leg in legs)} rad",
    }
    keep("backlash", settings, to, provenance, tables)
    return Exit.OK


def _figures(legs: "list[LegFit]") -> "Table":
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for heading in (
        "leg",
        "lead [mm/rad]",
        "pulley [mm]",
        "backlash [rad]",
        "stroke at home [mm]",
        "residual [rad rms]",
    ):
        table.add_column(Text(heading), justify="right")
    for i, leg in enumerate(legs, 1):
        table.add_row(
            str(i),
            f"{leg.eta_mm_per_rad:.5f} ± {leg.eta_sd_mm_per_rad:.5f}",
            f"{leg.pulley_radius_mm:.3f} ± {leg.pulley_radius_sd_mm:.3f}",
            f"{leg.backlash_rad:.3f} ± {leg.backlash_sd_rad:.3f}",
            f"{leg.home_stroke_mm:.3f}",
            f"{leg.residual_rad:.3f}",
        )
    return table
