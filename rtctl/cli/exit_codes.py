"""What the exit code of a command means: one table for every command."""

import enum


class Exit(enum.IntEnum):
    """Exit codes of ``rtctl``."""

    OK = 0
    FAILED = 1
    BAD_INPUT = 2
    UNREACHABLE = 3
    REFUSED = 4
    FAULT = 5
    DATA = 6
    INTERRUPTED = 130


MEANING: dict[Exit, str] = {
    Exit.OK: "done",
    Exit.FAILED: "not done, for the reason printed",
    Exit.BAD_INPUT: "an argument or a setting is wrong",
    Exit.UNREACHABLE: "a device, a backend or the daemon cannot be reached",
    Exit.REFUSED: "the controller refused the command",
    Exit.FAULT: "the controller is in fault",
    Exit.DATA: "a log cannot be written or read, records were lost, or a replay differs",
    Exit.INTERRUPTED: "interrupted with Ctrl-C",
}


def table() -> str:
    """The codes and their meanings as a list in Markdown, for help texts and the reference."""
    return "\n".join(f"- {code.value} {MEANING[code]}" for code in Exit)
