"""Answers requests. Every request gets exactly one reply, whatever is in it and whatever goes wrong."""

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, cast

import numpy as np

from hal.errors import RtctlError
from rtctl.commands import Reason, Verb, explain
from rtctl.exchange.control import RealTimeState, Word
from rtctl.gateway import messages
from rtctl.gateway.commander import VERDICT_S
from rtctl.gateway.feedback import numbers, operating_state
from rtctl.gateway.keys import CRTK_STATE_COMMANDS, REQUESTS, Key, Kind
from rtctl.gateway.messages import (
    Answer,
    CommandRequest,
    GetRequest,
    PlanRequest,
    Reply,
    Request,
    SetRequest,
    StateRequest,
)
from rtctl.gateway.refusal import Refusal, from_error
from rtctl.gateway.run import Run
from rtctl.gateway.staging import log_and_stage, next_number
from rtctl.log.format import PARAMETERS, PLANS
from rtctl.plan_file import from_document, known_plan
from rtctl.planner import make_plan


class Cancelled(Exception):
    """The gateway ends while a plan is computed."""


class Desk:
    """Knows what to do with every key of :data:`rtctl.gateway.keys.REQUESTS`. Safe to call from several threads."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._planning = threading.Lock()
        self._planned = ""
        self._closing = threading.Event()
        self._planner: threading.Thread | None = None

    def answer(self, name: str, payload: bytes, answer: Answer) -> None:
        """Handle the request `payload` on key `name` (below ``rtctl/<robot>/``) and have it answered."""
        _guarded(answer, lambda: self._dispatch(name, payload, answer))

    def close(self) -> None:
        """End a planning under way; its client is told."""
        self._closing.set()
        if self._planner is not None:
            self._planner.join(timeout=2.0)

    def _dispatch(self, name: str, payload: bytes, answer: Answer) -> None:
        key = REQUESTS.get(name)
        if key is None:
            raise Refusal("unknown_key", f"there is no key {name}", "see docs/reference/keys.md")
        request = messages.decode(key, payload)
        remaining_s = request.remaining_s(time.time_ns())
        if key.lease:
            self._run.lease.authorise(request.lease, request.sequence, time.monotonic())
        if key.kind is Kind.VERB or key.kind is Kind.STATE_COMMAND:
            self._command(key, request, remaining_s, answer)
        elif key.kind is Kind.PLAN:
            self._plan(cast(PlanRequest, request), answer)
        elif key.kind is Kind.SCOPE_OPEN or key.kind is Kind.SCOPE:
            answer(*self._run.scopes.answer(name, request))
        else:
            handle = {
                Kind.GET: self._get,
                Kind.SET: self._set,
                Kind.LIST: lambda _name, _request: Reply(accepted=True, result=self._run.parameters.reference()),
                Kind.LEASE: self._lease,
                Kind.STATUS: lambda _name, _request: Reply(accepted=True, result=self._status()),
            }[key.kind]
            answer(handle(name, request))

    def _command(self, key: Key, request: Request, remaining_s: float, answer: Answer) -> None:
        verb, arguments = key.verb, []
        if isinstance(request, StateRequest):
            if request.command not in CRTK_STATE_COMMANDS:
                remedy = "use one of " + ", ".join(CRTK_STATE_COMMANDS)
                raise Refusal("unknown_command", f"there is no state command {request.command!r}", remedy)
            verb = Verb[request.command.upper()]
        else:
            arguments = cast(CommandRequest, request).arguments
        count = key.argument_count(self._run.robot.dof)
        if len(arguments) != count:
            text = f"{verb.name.lower()} takes {count} numbers{f': {key.arguments}' if key.arguments else ''}"
            raise Refusal("wrong_arguments", text, "see docs/reference/keys.md", len(arguments), count)
        future = self._run.commander.post(verb, arguments, request.source, remaining_s, time.monotonic())
        future.add_done_callback(lambda f: _guarded(answer, lambda: answer(Reply(accepted=True, tick=f.result()))))

    def _get(self, _name: str, request: Request) -> Reply:
        return Reply(accepted=True, result=self._run.parameters.values(cast(GetRequest, request).names))

    def _set(self, _name: str, request: Request) -> Reply:
        run, values = self._run, cast(SetRequest, request).values
        settings = run.parameters.propose(values)
        row = self._latest()
        number = next_number(run.segment.parameters, int(row["parameter_set"]))
        record = run.parameters.packed(settings, number)
        content = {"number": number, "changed": values, "values": run.parameters.live_values(settings)}
        tick = self._load(Verb.SET_PARAMETERS, request, PARAMETERS, content, run.segment.parameters, record)
        run.parameters.adopt(values)
        run.tell("parameters", f"{request.source} set {', '.join(f'{k} = {v}' for k, v in values.items())}")
        return Reply(accepted=True, tick=tick, result={"number": number})

    def _plan(self, request: PlanRequest, answer: Answer) -> None:
        entry = np.array(self._latest()["pose_entry"])
        if not np.isfinite(entry).all():
            raise Refusal("not_registered", *explain(Reason.NOT_REGISTERED, np.nan, np.nan))
        if not self._planning.acquire(blocking=False):
            raise Refusal("busy", "a plan is being computed already", "wait for it")
        work = threading.Thread(
            target=lambda: _guarded(answer, lambda: answer(self._compute_plan(request, entry))),
            name="planning",
            daemon=True,
        )
        self._planner = work
        work.start()

    def _compute_plan(self, request: PlanRequest, entry: np.ndarray) -> Reply:
        run = self._run
        settings = run.parameters.settings
        try:
            known = None if request.plan is None else known_plan(settings, from_document(request.plan))
            number = next_number(run.segment.plans, int(self._latest()["plan_number"]))
            path = make_plan(settings, run.robot, entry, number, self._progress, known=known)
            run.lease.renew(request.lease, time.monotonic())
            content = {"number": number, "pose_entry": numbers(entry), **_readable(path)}
            tick = self._load(Verb.LOAD_PLAN, request, PLANS, content, run.segment.plans, path)
        except Cancelled:
            raise Refusal("stopping", "the controller is being stopped") from None
        except RtctlError as error:
            raise from_error("no_plan_found" if request.plan is None else "plan_refused", error) from None
        finally:
            self._planned = ""
            self._planning.release()
        run.tell("plan", f"plan {number} {'computed for' if known is None else 'loaded by'} {request.source}")
        return Reply(accepted=True, tick=tick, result={"number": number})

    def _progress(self, done: int, total: int) -> None:
        self._planned = f"{done}/{total}"
        if self._closing.is_set():
            raise Cancelled

    def _load(
        self, verb: Verb, request: Request, topic: str, content: dict[str, Any], slots: np.ndarray, record: np.ndarray
    ) -> int:
        """Log, stage and post; the tick at which the tick took it over."""
        run = self._run
        slot = log_and_stage(run.journal, topic, run.stamp()[0], content, slots, record)
        future: Future[int] = run.commander.post(
            verb, [float(content["number"])], request.source, VERDICT_S, time.monotonic(), slot
        )
        return future.result(timeout=2 * VERDICT_S)

    def _lease(self, name: str, request: Request) -> Reply:
        lease, now = self._run.lease, time.monotonic()
        if name == "lease/acquire":
            token = lease.acquire(request.source, now)
            self._run.say_health()  # before the holder's first command, so that the tick does not miss an operator
            self._run.tell("lease", f"{request.source} holds the lease")
            return Reply(accepted=True, result={"lease": token, "lease_s": lease.duration_s})
        if name == "lease/renew":
            lease.renew(request.lease, now)
        else:
            lease.release(request.lease)
            self._run.say_health()
            self._run.tell("lease", f"{request.source} released the lease")
        return Reply(accepted=True)

    def _status(self) -> dict[str, Any]:
        run, row = self._run, self._run.latest
        state = {} if row is None else operating_state(row, run.word(Word.GRADE), run.lease.holder, run.watcher.causes)
        return {
            "robot": run.settings.robot.name,
            "kind": run.settings.robot.kind,
            "dof": run.robot.dof,
            "backend": run.settings.backend.name,
            **state,
            "real_time": RealTimeState(run.word(Word.REAL_TIME_STATE)).name.lower(),
            "parameter_set": None if row is None else int(row["parameter_set"]),
            "plan_number": None if row is None else int(row["plan_number"]),
            "pose_entry": None if row is None else numbers(row["pose_entry"]),
            "planning": self._planned,
            "overruns": run.word(Word.OVERRUNS),
            "missed_ticks": run.word(Word.MISSED_TICKS),
            "max_lateness_ns": run.word(Word.MAX_LATENESS_NS),
            "lost_records": run.word(Word.LOST_RECORDS),
            "log": str(run.journal.path),
            "log_failure": run.journal.failure,
            "lease_s": run.lease.duration_s,
        }

    def _latest(self) -> Any:
        row = self._run.latest
        if row is None:
            raise Refusal("not_running", "the control loop has not run yet", "look at `rtctl status`")
        return row


def _guarded(answer: Answer, action: Callable[[], object]) -> None:
    """Do `action`, which answers; answer for it if it fails."""
    try:
        action()
    except Refusal as refusal:
        answer(messages.refuse(refusal))
    except Exception:
        logging.getLogger(__name__).exception("a request failed")
        answer(messages.refuse(Refusal("internal", "an error of the gateway; it is in its journal", "report it")))


def _readable(path: np.ndarray) -> dict[str, Any]:
    """The knots of a path for people who read the log."""
    record = path[0]
    n, channels = int(record["intervals"]), int(record["channels"])
    return {
        "depth_mm": record["depth_mm"][: n + 1].tolist(),
        "pose_and_stylet": record["coefficient"][:n, :channels, 3].tolist(),
        "entry_in_base": record["entry_in_base"].tolist(),
        "insertion_axis_in_base": record["insertion_axis_in_base"].tolist(),
    }
