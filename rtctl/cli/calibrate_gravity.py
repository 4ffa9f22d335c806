"""``rtctl calibrate gravity``: what the force sensor carries."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.calibrated import SIM, TO, keep
from rtctl.cli.connection import ClientOperator, connect, stopping
from rtctl.cli.console import grid, output, remark
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import DEFAULT_ENDPOINT, DEFAULT_ROBOT, ENDPOINT, ROBOT, SEED, SET
from rtctl.cli.progress import shown

if TYPE_CHECKING:
    from rtctl.calibrate.gravity_run import Gravity, Readings
    from rtctl.settings import Settings


def add_to(group: typer.Typer) -> None:
    """Add the command."""
    group.command()(gravity)


def gravity(
    poses: Annotated[int, typer.Option(help="How many orientations.", min=6, max=200)] = 12,
    method: Annotated[str, typer.Option(help="linear, or sphere where the robot turns about two axes.")] = "linear",
    bound: Annotated[float, typer.Option(help="Largest force that may be left [N].", min=0.001, max=10.0)] = 0.03,
    to: TO = None,
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
    sim: SIM = None,
    seed: SEED = 0,
    overrides: SET = None,
) -> int:
    """Find the weight and the centre of mass of what the force sensor carries, by turning it where it stands.

    The gripper must be empty, away from everything, and the robot homed. The result is a file of settings.

    Example: `rtctl calibrate gravity --poses 20`
    """
    from rtctl.calibrate.gravity_run import METHODS

    if method not in METHODS:
        raise typer.BadParameter(f"--method is one of {', '.join(METHODS)}")
    if sim is None and (seed or overrides):
        raise typer.BadParameter("--seed and --set belong to --sim: a running controller has its settings already")
    if sim is None:
        settings, readings = _of_the_controller(robot, endpoint, poses)
        origin = f"the controller at {endpoint}"
    else:
        settings, readings = _of_the_simulation(sim, overrides or [], seed, poses)
        origin = f"simulation with seed {seed}"
    return _report(settings, readings, method, bound, origin, to)


def _numbers(values: "Any", digits: int) -> str:
    return ", ".join(f"{v:.{digits}f}" for v in values)


def _figures(found: "Gravity", bound: float) -> dict[str, str]:
    return {
        "weight in {B}": f"{_numbers(found.force.gravity_force_in_base_n, 4)} N",
        "centre of mass in {F}": f"{_numbers(found.moment.centre_of_mass_in_sensor_mm, 2)} mm",
        "bias": f"{_numbers(found.force.bias_in_sensor_n, 4)} N, {_numbers(found.moment.bias_in_sensor_nmm, 2)} N mm",
        "left at poses not fitted": f"{found.left_n.max():.4f} N at most (bound {bound:g}), {found.left_nmm.max():.2f} N mm",
    }


def _of_the_controller(robot: str, endpoint: str, poses: int) -> "tuple[Settings, Readings]":
    """Turn the robot through the daemon, from where it stands."""
    from rtctl.calibrate import gravity_run
    from rtctl.settings import from_table

    with connect(robot, endpoint) as client, shown() as progress, stopping(client):
        table: dict = {}
        for name, value in client.parameters().items():
            section, option = name.split(".")
            table.setdefault(section, {})[option] = value
        settings = from_table(table)
        return settings, gravity_run.run(ClientOperator(client), settings, poses, progress)


def _of_the_simulation(config: str, overrides: list[str], seed: int, poses: int) -> "tuple[Settings, Readings]":
    """Home a simulated robot, and turn it in the middle of its workspace."""
    from rtctl.calibrate import gravity_run
    from rtctl.calibrate.simulated import SimulatedRobot
    from rtctl.settings import load

    settings = load(config, overrides)
    simulated = SimulatedRobot(settings, seed)
    with shown() as progress:
        simulated.script(("to the middle",), progress).move("to the middle", simulated.middle(), settings)
    with shown() as progress:
        readings = gravity_run.run(simulated.operator, settings, poses, progress)
    simulated.close()
    return settings, readings


def _report(settings: "Settings", readings: "Readings", method: str, bound: float, origin: str, to: Path | None) -> int:
    """Fit, tell, and keep it if it is good."""
    from rtctl.calibrate import gravity_run

    found = gravity_run.fit(readings, method)
    output().print(grid(_figures(found, bound)))
    for sentence in found.not_told():
        remark(sentence)
    gravity_run.require(found, bound)
    provenance = {
        "from": f"{origin}, {len(readings.turns)} poses, {method} fit",
        "left at poses the fit had not seen": f"{found.left_n.max():.4f} N and {found.left_nmm.max():.2f} N mm at most",
        "bias at the time": f"{_numbers(found.bias_in_sensor, 3)} N, N mm in {{F}}",
        "not told by these poses": "; ".join(found.not_told()) or "nothing",
    }
    wrench = {
        "gravity_force_in_base_n": found.force.gravity_force_in_base_n.round(5).tolist(),
        "centre_of_mass_in_sensor_mm": found.moment.centre_of_mass_in_sensor_mm.round(4).tolist(),
    }
    keep("gravity", settings, to, provenance, {"wrench": wrench})
    return Exit.OK
