"""The pages: which table each of them shows, and the few words around it."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from importlib.metadata import entry_points
from typing import Any

from hal import backend as backends
from hal import device as devices
from hal import troubles
from hal.errors import OptionError
from hal.options import bound_text, describe
from hal.signals import Signal
from rtctl.attribution.causes import CAUSES
from rtctl.cli import app
from rtctl.cli.exit_codes import MEANING
from rtctl.commands import EXPLANATIONS, Reason, Verb
from rtctl.gateway import keys
from rtctl.lifecycle import NEVER_BLOCK_RETRACTION, TABLE, Operating, permits
from rtctl.plan_file import VERSION, PlanFile
from rtctl.record import INPUTS, TIMING, controller_table
from rtctl.reference.command_line import commands as help_of_commands
from rtctl.reference.markdown import blanks, page, table
from rtctl.reference.options import sections
from rtctl.robots import GEOMETRIES
from rtctl.settings import Settings
from rtctl.stages import LATE_SHARE, STAGES, TICK_SHARE
from rtctl.summary import FIGURES


def settings() -> str:
    """Every option of the settings file, then those of robots and backends."""
    parts = [
        "A settings file is TOML. Whatever is not in this list is refused, with the nearest known key. Numbers must lie"
        " within their bounds, ends included. Live options can be changed while the controller runs"
        " (`rtctl param set`); all others take effect at the next start.",
        *sections(Settings, ""),
        "## Geometry of the robots",
        "The controller's model of the machine; `[robot] kind` says whose.",
    ]
    for kind, options in GEOMETRIES.items():
        parts += sections(options, "robot.geometry", kind)
    parts += ["## Options of the backends", "What `[backend.options]` may hold; `[backend] name` says whose."]
    for name, backend in _backends():
        if hasattr(backend, "options_type"):
            parts += sections(backend.options_type, getattr(backend, "options_path", "backend.options"), name)
    parts += [
        "## Options of the devices",
        "What a table `[[backend.options.devices]]` of the backend `hardware` may hold beside `name`; its `kind` says which. How they are wired is in the [how-to pages](../how-to/add-a-device.md).",
    ]
    for entry in sorted(entry_points(group=devices.GROUP)):
        parts += sections(entry.load().options_type, "devices", entry.name)
    return page("Settings", "rtctl/settings.py, the robots and the backends", parts)


def signals() -> str:
    """The controller's record and the truths of the simulations."""
    parts = [
        "One record a tick, the same bytes in shared memory, in the log (topic `/controller`) and on the wire (key"
        " `record`). Shapes are those of the planar robot: its pose has three coordinates (x, y, phi of the gripper tip"
        " in the robot base {B}); its axes are three motors and, last, the stylet's. {F} is the force sensor. A number"
        " that is not known is NaN.",
        "A replay feeds what is marked *input*. What is marked *timing* is measured and differs from run to run. All else"
        " must come out of a replay identical to the bit.",
        _signals(controller_table(3).signals, _part),
    ]
    for name, backend in _backends():
        truth = None
        if backend.simulated:
            with suppress(OptionError):  # one that cannot do without settings has the truth of another
                truth = backends.load(name, {}, period_s=0.001, seed=0).truth()
        if truth is not None:
            parts += [
                f"## What the backend `{name}` knows",
                "The truth of a simulation (topic `/truth`), which the controller never sees.",
                _signals(truth[0].signals),
            ]
    return page("Signals", "rtctl/record.py and the backends", parts)


def commands() -> str:
    """Verbs, the states that permit them, and the reasons of refusals."""
    asked = {key.verb: key for key in keys.REQUESTS.values()}
    verbs = []
    for verb in Verb:
        if verb != Verb.NONE:
            key = asked.get(verb)
            states = [s.name for s in Operating if permits.py_func(s, verb)]  # type: ignore[attr-defined]
            verbs.append(
                (
                    f"`{verb.name.lower()}`",
                    int(verb),
                    key.arguments if key else "number of the set or plan",
                    "any" if len(states) == len(Operating) else ", ".join(states),
                    ("holder of the lease" if key.lease else "everybody") if key else "the gateway",
                    key.doc if key else "what the gateway has staged takes effect",
                )
            )
    reasons = [(f"`{r.name.lower()}`", int(r), blanks(e.text), e.remedy) for r, e in EXPLANATIONS.items()]
    return page(
        "Commands",
        "rtctl/commands.py, rtctl/lifecycle.py and rtctl/gateway/keys.py",
        [
            "Every command is judged in the tick that reads it. The verdict is in the record (`command_verdict`) and in"
            f" the reply: {int(Reason.ACCEPTED)} is accepted, anything larger a reason of the second table.",
            "## Verbs",
            table(("verb", "number", "arguments", "possible in state", "who may", "meaning"), verbs),
            "## Reasons of a refusal",
            "Besides the state, a command needs what its motion needs. The number that was wrong and the bound it broke"
            " come with the reason (`reason_value`, `reason_bound`).",
            table(("reason", "number", "what is told", "what to do"), reasons),
        ],
    )


def conditions() -> str:
    """The condition table."""
    rows = []
    for c, row in TABLE.items():
        way_out = "open" if c in NEVER_BLOCK_RETRACTION else ""
        rows.append((int(c), f"`{c.name.lower()}`", row.reaction.name, way_out, blanks(row.text), row.remedy))
    return page(
        "Conditions",
        "rtctl/lifecycle.py",
        [
            "Everything that can be wrong, and what the controller then does by itself. NOTE is only recorded. STOP ends"
            " the motion along a jerk-limited brake and holds. PAUSE does the same, and nothing moves until `resume`."
            " FAULT removes power in the same tick and stays until `acknowledge`. The bounds are in `[safety]` and"
            " `[trajectory]` of the [settings](settings.md); the bit is that of `condition_active` and"
            " `condition_latched`.",
            "A condition whose way out is *open* neither pauses nor refuses a retraction.",
            table(("bit", "condition", "reaction", "way out", "what is told", "what to do"), rows),
        ],
    )


def trouble_table() -> str:
    """What devices can report."""
    rows = [
        (int(t), f"`{t.name.lower()}`", r.grade.name.lower(), blanks(r.text), r.remedy)
        for t, r in troubles.TABLE.items()
    ]
    return page(
        "Troubles of devices",
        "hal/troubles.py",
        [
            "What a device of the hardware backend can report, and what it asks of the controller: a *warning* raises the"
            " condition `device_warning`, a *pause* `device_pause`, a *fault* `device_fault`; see"
            " [Conditions](conditions.md). The code is that of the signal `trouble`, the number in the text"
            " `trouble_value`, and `trouble_device` counts the devices of the settings from 0. That measured values must not"
            " be used is told by their validity, beside this.",
            table(("code", "trouble", "grade", "what is told", "what to do"), rows),
        ],
    )


def key_table() -> str:
    """Zenoh keys."""
    rows = [(f"`{name}`", arguments, who, doc) for name, arguments, who, doc in keys.reference()]
    return page(
        "Keys",
        "rtctl/gateway/keys.py",
        [
            "All keys live below `rtctl/<robot>/`. A request is a Zenoh query with a JSON payload and gets a JSON reply:"
            " see [Operate by Zenoh](../how-to/operate-by-zenoh.md). `dof` is the number of pose coordinates, 3 for the"
            " planar robot.",
            table(("key", "arguments", "who may", "meaning"), rows),
        ],
    )


def stages() -> str:
    """What a tick is made of, and what may hold it."""
    rows = [(f"`{s.name}`", s.what, f"{s.budget_us:g}", s.reason) for s in STAGES]
    causes = [(c.name, "made it worse" if c.hint else "held it", c.remedy) for c in CAUSES]
    return page(
        "Stages of a tick",
        "rtctl/stages.py and rtctl/attribution/causes.py",
        [
            "In order, as in the signal `stage_ns`. `make bench` (part `stages`) measures each against its budget. A"
            " budget is a time, whatever the rate of the loop; the bounds of a whole tick are shares of the period.",
            table(("stage", "what happens", "budget [µs]", "why so much"), rows),
            f"A tick is over budget if it takes more than {TICK_SHARE:g} of the period, if it is woken later than"
            f" {LATE_SHARE:g} of it, or if grid points were missed before it.",
            "## What may hold the loop",
            "Causes by which a black box names who held it, the strongest sign first. How they are told apart is in"
            " [real time](../explanation/real-time.md), what to do with a black box in"
            " [find what held the loop](../how-to/find-what-held-the-loop.md).",
            table(("cause", "then it", "what to do"), causes),
        ],
    )


def figures() -> str:
    """Keys of summary.json."""
    return page(
        "Summary of a run",
        "rtctl/summary.py",
        [
            "`summary.json` in the folder of a run, and the answer of `rtctl sim --json`. What is not known is null.",
            table(("key", "unit", "meaning"), [(f"`{f.name}`", f.unit, f.meaning) for f in FIGURES]),
        ],
    )


def plan_file() -> str:
    """What is in the file of a plan."""
    fields = [
        (where or "top level", f"`{name.rsplit('.', 1)[-1]}`", f.metadata["unit"], bound_text(f), f.metadata["doc"])
        for name, _, f in describe(PlanFile)
        for where in (f"`{name.rpartition('.')[0]}`" if "." in name else "",)
    ]
    return page(
        "Plan file",
        "rtctl/plan_file.py",
        [
            f"The file of `rtctl plan make` is JSON, format version {VERSION}. Every field is required, and no other is"
            " allowed. The same document goes to the controller in the field `plan` of a request on the key `plan`. How to"
            " work with it: [Make and use a plan](../how-to/make-and-use-a-plan.md).",
            table(("in", "field", "unit", "bounds", "meaning"), sorted(fields, key=lambda row: row[0] != "top level")),
            "Poses are those of the frame {E} at the grip ribs of the array in the frame {C} of the cochlea: origin in the"
            " centre of the spiral, x axis through 10.3 degrees of the template, and the angle of the spiral growing"
            " counter-clockwise, for a left ear too. At a registered entry $(x, y, \\varphi)_e$ in {B} they are"
            " $p_B=p_e+R(\\varphi_e-\\varphi_C)(p_C-p_c)$ and $\\varphi_B=\\varphi+\\varphi_e-\\varphi_C$, with"
            " $\\varphi_C$ = 146.342 degrees, and $p_c$ the centre of the cochleostomy, (4.406825, 0.530991) mm times A / 3.84 mm.",
            "Between the depths the pose follows a cubic spline (not-a-knot), the stylet a shape-preserving one.",
        ],
    )


def command_line() -> str:
    """Every command of the program, and its exit codes."""
    codes = table(("code", "meaning"), [(int(code), meaning) for code, meaning in MEANING.items()])
    return page("Command line", "rtctl/cli", [*help_of_commands(app), "## Exit codes", codes])


PAGES: dict[str, Callable[[], str]] = {
    "settings.md": settings,
    "signals.md": signals,
    "commands.md": commands,
    "conditions.md": conditions,
    "troubles.md": trouble_table,
    "keys.md": key_table,
    "stages.md": stages,
    "summary.md": figures,
    "plan-file.md": plan_file,
    "cli.md": command_line,
}


def _backends() -> Iterator[tuple[str, Any]]:
    """Name and class of every installed backend."""
    for entry in sorted(entry_points(group=backends.GROUP)):
        yield entry.name, entry.load()


def _part(name: str) -> str:
    return "input" if name in INPUTS else "timing" if name in TIMING else ""


def _signals(rows: Iterable[Signal], part: Callable[[str], str] | None = None) -> str:
    """Signals with type, unit, frame and meaning, and what `part` tells of each name."""
    head = ("signal", "type", "unit", "frame", *(("part",) if part else ()), "meaning")
    return table(
        head,
        [
            (
                f"`{s.name}`",
                s.type + (f"[{', '.join(map(str, s.shape))}]" if s.shape else ""),
                s.unit,
                s.frame,
                *((part(s.name),) if part else ()),
                s.meaning,
            )
            for s in rows
        ],
    )
