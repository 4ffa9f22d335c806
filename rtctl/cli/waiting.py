"""Waiting for the end of a motion, and saying how it ended."""

from collections.abc import Callable
from typing import Any

from rtctl.cli.connection import ClientOperator
from rtctl.cli.console import say
from rtctl.cli.exit_codes import Exit


def until_at_rest(
    operator: ClientOperator, what: str, tick: int, timeout_s: float, done: Callable[[Any], bool] = lambda _: True
) -> int:
    """Wait until nothing moves any more after `tick`; OK if `done` holds then.

    Raises:
        WorkflowError: it did not come to its end.
    """
    from rtctl.lifecycle import Operating
    from rtctl.workflow import WorkflowError

    record = operator.wait(lambda r: r["tick"] >= tick and not r["is_busy"], timeout_s)
    fine = (
        record is not None
        and record["tick"] >= tick
        and not record["is_busy"]
        and record["operating_state"] == Operating.ENABLED
        and record["stop_cause"] < 0
        and done(record)
    )
    if fine:
        say(f"{what}: done")
        return Exit.OK
    causes = [] if record is None else operator.causes(record)
    over = record is not None and not record["is_busy"]
    reason = "ended early" if over else f"not finished after {timeout_s:g} s"
    raise WorkflowError(what, reason, "look at `rtctl status`", causes, record)
