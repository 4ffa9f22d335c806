"""``python -m rtctl.gateway --memory-fd N --settings-fd M --run-directory DIR``: started by the supervisor."""

import argparse
import logging
import os
import signal
import sys
from pathlib import Path

from hal.errors import RtctlError
from rtctl.handover import read_settings


def main() -> int:
    """Run the gateway of one run to its end."""
    parser = argparse.ArgumentParser(prog="rtctl.gateway", description=__doc__)
    parser.add_argument("--memory-fd", type=int, required=True, help="inherited descriptor of the shared memory")
    parser.add_argument("--settings-fd", type=int, required=True, help="inherited memory file: JSON of the settings")
    parser.add_argument("--run-directory", type=Path, required=True, help="where the log goes")
    parser.add_argument("--seed", type=int, default=0, help="seed of the run, for the log")
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="gateway: %(levelname)s %(message)s")
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal tells all of us; the supervisor decides
    try:
        from rtctl.gateway.process import Gateway

        settings = read_settings(arguments.settings_fd)
        gateway = Gateway(arguments.memory_fd, settings, arguments.run_directory, arguments.seed)
    except RtctlError as error:
        logging.error("%s", error)
        return error.exit_code
    signal.signal(signal.SIGTERM, lambda _number, _frame: gateway.stop())
    return gateway.serve()


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # all is closed; what a library's thread still holds must not keep the process
