"""What the real-time process would obtain, by asking as it does: in a process of its own, which then ends.

    python -m rtctl.readiness.obtained SETTINGS_FD

prints the report of :class:`rtctl.machine.Machine`. There is no second opinion on the grade.
"""

import json
import os
import subprocess
import sys
from dataclasses import dataclass

from hal.errors import RtctlError
from rtctl.daemon import SINGLE_THREADED
from rtctl.exchange.control import Grade
from rtctl.handover import read_settings, write_settings
from rtctl.machine import Check, Machine
from rtctl.settings import Settings

LIMIT_S = 60.0


@dataclass(frozen=True)
class Obtained:
    """Grade and checks of a real-time process on this machine, for this user."""

    grade: Grade
    checks: tuple[Check, ...]


def obtain(settings: Settings) -> Obtained:
    """Ask in a child process. Raises RtctlError if it fails, with what it said."""
    fd = write_settings(settings)
    try:
        command = [sys.executable, "-m", __name__, str(fd)]
        result = subprocess.run(command, pass_fds=[fd], env=os.environ | SINGLE_THREADED, capture_output=True, text=True, timeout=LIMIT_S)  # fmt: skip
    except subprocess.TimeoutExpired:
        raise RtctlError("the machine does not answer when it is asked for real time", bound=f"{LIMIT_S:g} s") from None
    finally:
        os.close(fd)
    if result.returncode != 0:
        raise RtctlError("the machine could not be asked for real time", value=result.stderr.strip()[-500:])
    told = json.loads(result.stdout)
    return Obtained(Grade(told["grade"]), tuple(Check(**check) for check in told["checks"]))


def main() -> int:
    """See the head of the module."""
    machine = Machine(read_settings(int(sys.argv[1])).loop)
    print(json.dumps({"grade": int(machine.grade()), "checks": machine.as_table()}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
