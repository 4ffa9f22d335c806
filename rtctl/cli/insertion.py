"""A whole insertion through a daemon of its own, and its report: what ``rtctl demo`` and ``rtctl bench hil`` share."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rtctl.cli.console import grid, output, remark, say, say_error
from rtctl.cli.exit_codes import Exit

if TYPE_CHECKING:
    from rtctl.settings import Settings


def insert_through_daemon(
    settings: "Settings", config: str, overrides: list[str], seed: int, directory: Path
) -> tuple[Exit, dict[str, Any] | None]:
    """Start the daemon, do the work-flow, end it, write and tell the report; the figures are None without a log."""
    from hal.errors import RtctlError
    from rtctl import report, robots
    from rtctl.cli.child import Daemon
    from rtctl.cli.outcome import exit_code, key_figures
    from rtctl.cli.progress import shown
    from rtctl.recording import logs_in
    from rtctl.workflow import insert_array

    robot = robots.load(settings.robot.kind, settings.robot.geometry)
    failure: RtctlError | None = None
    remark("starting the daemon; the first time, kernels are compiled, which takes a minute")
    with Daemon(settings, config, overrides, seed, directory) as daemon:
        try:
            operator = daemon.operator()
            with shown() as progress:
                insert_array(operator, settings, robot, progress)
        except RtctlError as error:
            failure = error
    if failure is not None:
        say_error(str(failure))
        if not logs_in(directory):
            return Exit(failure.exit_code), None
    figures = report.write(directory)
    output().print(grid(key_figures(figures)))
    say(f"report: {directory / 'report.html'}")
    code = exit_code(figures, failure)
    if code is Exit.OK and daemon.exit_code != 0:
        say_error(f"the daemon ended with {daemon.exit_code}; see {daemon.output}")
        return Exit.FAILED, figures
    return code, figures
