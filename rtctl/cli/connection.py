"""A client for a command, and what to do when its user presses Ctrl-C while something moves."""

import contextlib
import os
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from hal.errors import RtctlError
from rtctl.cli.console import remark

if TYPE_CHECKING:
    from rtctl.client import Client
    from rtctl.commands import Verb
    from rtctl.workflow import Cause

POLL_S = 0.2


def connect(robot: str, endpoint: str) -> "Client":
    """A client of the daemon; user and password come from RTCTL_USER and RTCTL_PASSWORD.

    Raises:
        NoReply: nobody answers at the endpoint.
    """
    from rtctl.client import Client

    user, password = credentials()
    return Client(robot, endpoint, user=user, password=password)


def credentials() -> tuple[str, str]:
    """User and password, from RTCTL_USER and RTCTL_PASSWORD."""
    return os.environ.get("RTCTL_USER", ""), os.environ.get("RTCTL_PASSWORD", "")


@contextlib.contextmanager
def stopping(client: "Client") -> Iterator[None]:
    """Ctrl-C inside stops the robot before it ends the command."""
    try:
        yield
    except KeyboardInterrupt:
        with contextlib.suppress(RtctlError):
            client.stop()
            remark("rtctl: stopped")
        raise


class ClientOperator:
    """An :class:`rtctl.workflow.Operator` that works through the daemon."""

    def __init__(self, client: "Client") -> None:
        self.client = client

    def command(self, verb: "Verb", *arguments: float) -> int:
        """See :meth:`rtctl.client.Client.command`."""
        return self.client.command(verb, *arguments).tick or 0

    def wait(self, until: Callable[[Any], bool], timeout_s: float) -> Any:
        """The first record for which `until` holds, or the newest one after `timeout_s`."""
        from rtctl.client import WaitedTooLong

        try:
            return self.client.wait(until, timeout_s)
        except WaitedTooLong:
            return self.client.latest()

    def plan(self, _progress: Callable[[float], None]) -> int:
        """See :meth:`rtctl.client.Client.plan`."""
        return self.client.plan().tick or 0

    def causes(self, record: Any) -> "list[Cause]":
        """What the controller says about the conditions in `record`."""
        from rtctl.gateway.events import say
        from rtctl.lifecycle import TABLE
        from rtctl.workflow import Cause, conditions_of

        told: dict[str, Cause] = {}
        with contextlib.suppress(RtctlError):
            status = self.client.status()
            entries = [*status.get("conditions", ()), status.get("fault_cause")]
            told = {entry["name"]: Cause(entry["text"], entry["remedy"]) for entry in entries if entry}
        return [told.get(c.name.lower(), Cause(say(c), TABLE[c].remedy)) for c in conditions_of(record)]
