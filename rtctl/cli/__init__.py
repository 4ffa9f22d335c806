"""The command line: one verb a user would say, one function. ``rtctl --help`` shows them all.

Modules of the commands import nothing heavy; what a command needs is imported when it runs.
"""

import sys
from typing import Any

import typer

from rtctl.cli import (
    bench,
    calibrate,
    client,
    configuration,
    daemon,
    detector,
    devices,
    doctor,
    logs,
    motion,
    operate,
    parameters,
    plan,
    scope,
    simulation,
    study,
    watching,
)
from rtctl.cli.console import say_error
from rtctl.cli.exit_codes import Exit, table

EPILOG = f"Exit codes:\n\n{table()}"

app = typer.Typer(
    name="rtctl",
    help="Real-time control of robot-assisted cochlear-implant insertion.",
    epilog=EPILOG,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode="markdown",
)
for family in (
    daemon, simulation, bench, watching, scope, devices, doctor, client, motion, operate, plan, parameters, logs,
    configuration, calibrate, detector, study,
):  # fmt: skip
    family.add_to(app)


def main(arguments: list[str] | None = None) -> int:
    """Run one command; its exit code (:class:`rtctl.cli.exit_codes.Exit`). Errors are told, never traced."""
    from hal.errors import RtctlError

    try:
        result: Any = app(arguments, standalone_mode=False)
    except RtctlError as error:
        say_error(str(error))
        return error.exit_code
    except typer.Exit as exit_request:
        return exit_request.exit_code
    except (KeyboardInterrupt, typer.Abort):
        say_error("interrupted")
        return Exit.INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()  # whoever read our output has gone; there is nobody to tell
        return Exit.FAILED
    except Exception as error:
        if not hasattr(error, "show"):
            raise
        error.show()  # an error of usage knows how to tell itself
        return Exit.BAD_INPUT
    return int(result) if isinstance(result, int) else Exit.OK
