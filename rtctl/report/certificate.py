"""A certificate as one HTML page that needs nothing else, drawn from the document alone."""

import json
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from rtctl.readiness.verdicts import BROKEN, KEPT, UNPROVEN
from rtctl.report.certificate_pictures import draw
from rtctl.report.page import Picture, columns, fill
from rtctl.report.style import GREEN, ORANGE, RED, svg

COLOURS = {KEPT: GREEN, BROKEN: RED, UNPROVEN: ORANGE}
MARKS = {True: "kept", False: "NOT KEPT", None: "not known"}
MARK_CLASSES = {True: "info", False: "error", None: "warning"}
VERDICT_CLASSES = {"good": "info", "costs": "error", "unknown": "warning"}
UNKNOWN = "not known"
LONG_US = 1e4
"""From here on milliseconds are easier to read."""

Document = Mapping[str, Any]


def page(document: Document) -> str:
    """The page, an HTML text."""
    return fill(
        "certificate.html",
        COLOURS.get(document["verdict"], ORANGE),
        title=escape(f"Real-time certificate of robot {document['robot']}: promises {document['verdict']}"),
        outcome=escape(document["verdict"] if document["complete"] else f"{document['verdict']}, incomplete"),
        subtitle=_subtitle(document),
        causes=_causes(document),
        tiles="".join(_tiles(document)),
        verdicts=_table(("promise", "bound", "measured", ""), map(_verdict, document["verdicts"])),
        pictures=columns(Picture(title, svg(f), caption, f.get_figheight()) for title, caption, f in draw(document)),
        percentiles=_percentiles(document),
        overruns=_overruns(document),
        boxes=_boxes(document["black_boxes"]),
        process=_table((), (("", name, _shown(value)) for name, value in document["process"].items())),
        facts=_table((), (("", name, value) for name, value in _facts(document))),
        findings=_table(("what", "found", "what it costs", "mend it with"), map(_finding, document["findings"])),
        settings=escape(json.dumps(document["settings"], indent=1, ensure_ascii=False)),
    )


def _subtitle(d: Document) -> str:
    parts = (
        f"{d['begun']} to {d['ended']}",
        f"{d['rounds']} of {d['rounds_asked']} rounds of {d['round_s']:g} s",
        f"load: {d['load']['what']}",
        f"backend {d['backend']}, {d['operation']}",
        f"core {d['loop']['core']}, priority {d['loop']['priority']}, every {d['loop']['period_us']:g} µs",
    )
    return " · ".join(escape(part) for part in parts) + f"<br>SHA-256 <code>{escape(d['sha256'])}</code>"


def _causes(d: Document) -> str:
    lines = []
    if not d["complete"]:
        lines.append("The measurement was interrupted. It proves nothing, and no log names it.")
    if d["reference"]["obstacle"]:
        lines.append(f"There is no reference, so no ratio: {d['reference']['obstacle']}.")
    return f'<div class="causes">{"".join(f"<p>{escape(line)}</p>" for line in lines)}</div>' if lines else ""


def _tiles(d: Document) -> Iterable[str]:
    late, tick = d["lateness"], d["tick"]
    yield _tile(_us(late["percentiles_us"]["p50"]), "lateness, median")
    yield _tile(_us(late["percentiles_us"]["p99"]), "lateness, 99 %")
    yield _tile(_us(late["longest_us"]), "latest wake-up")
    yield _tile(_us(tick["percentiles_us"]["p50"]), "tick, median")
    yield _tile(_us(tick["longest_us"]), "longest tick")
    yield _tile(f"{late['count']}", "ticks")
    yield _tile(f"{d['overruns']['missed_ticks']}", "ticks missed")
    yield _tile(f"{d['ratios']['p99']['median']:.2f}" if d["ratios"] else "–", "99 % over cyclictest's")


def _tile(value: str, words: str) -> str:
    return f'<div class="tile"><b>{escape(value)}</b><span>{escape(words)}</span></div>'


def _verdict(v: Document) -> tuple[str, ...]:
    return MARK_CLASSES[v["kept"]], v["name"], f"{_shown(v['bound'])} {v['unit']}", _shown(v["measured"]), MARKS[v["kept"]]  # fmt: skip


def _percentiles(d: Document) -> str:
    reference, rows = d["reference"].get("lateness"), []
    for name in (*d["lateness"]["percentiles_us"], "longest"):
        ours, tick = _of(d["lateness"], name), _of(d["tick"], name)
        theirs = None if reference is None else _of(reference, name)
        ratio = d["ratios"] and d["ratios"].get(name)
        between = "" if not ratio else f"{ratio['median']:.3g} ({ratio['low_quartile']:.3g} to {ratio['high_quartile']:.3g}); {ratio['together']:.3g}"  # fmt: skip
        rows.append(("", name, _us(tick), _us(ours), "–" if theirs is None else _us(theirs), between))
    heads = ("", "tick", "lateness", "cyclictest", "lateness over cyclictest: median (quartiles) of the rounds; all together")  # fmt: skip
    return _table(heads, rows)


def _of(times: Document, name: str) -> float:
    return times["longest_us"] if name == "longest" else times["percentiles_us"][name]


def _overruns(d: Document) -> str:
    o, ticks = d["overruns"], d["lateness"]["count"]
    text = f"{o['overruns']} times grid points were missed, {o['missed_ticks']} in all, beside {ticks} ticks."
    theirs = d["reference"].get("later_than_a_period")
    if theirs is not None:
        text += f" cyclictest woke up later than a period {theirs} times."
    if not o["overruns"]:
        return f"<p>{escape(text)}</p>"
    held = ", ".join(f"{part} {count}" for part, count in o["held_by"].items() if count)
    rows = (("", *map(_shown, (x["round"], x["tick"], x["missed_ticks"], x["held_by"], x["lateness_us"], x["tick_us"]))) for x in o["longest"])  # fmt: skip
    table = _table(("round", "after tick", "missed", "longest part of it", "lateness [µs]", "tick [µs]"), rows)
    return f"<p>{escape(text)} The longest part of what came before: {escape(held)}.</p>{table}"


def _boxes(b: Document) -> str:
    """Who held the loop."""
    if not b["causes"]:
        return "<p>No tick was over budget.</p>"
    causes = ", ".join(f"{name} {count}" for name, count in b["causes"].items())
    text = f"Black boxes by their strongest cause: {causes}. Ticks over budget without a box of their own: {b['left_out']}."
    rows = (("", _shown(x["round"]), _shown(x["tick"]), x["text"], x["remedy"]) for x in b["told"])
    table = _table(("round", "tick", "what happened", "what to do"), rows)
    return f"<p>{escape(text)}</p><details><summary>The first {len(b['told'])} of them</summary>{table}</details>"


def _facts(d: Document) -> Iterable[tuple[str, str]]:
    load = d["load"]
    yield "grade", d["loop"]["grade"]
    yield "load", f"{load['what']}: {load['processes']} processes on cores {load['cores']}, which used {_shown(load['used_s'])} s of the processors in {load['lasted_s']} s"  # fmt: skip
    for name, value in d["machine"].items():
        yield f"machine: {name}", _shown(value)
    yield "settings", d["config_hash"]
    yield "kernels", d["kernel_hash"]
    yield "revision", d["revision"] or UNKNOWN
    yield "packages", ", ".join(f"{name} {version}" for name, version in d["packages"].items())


def _finding(f: Document) -> tuple[str, ...]:
    return VERDICT_CLASSES[f["verdict"]], f["name"], f["found"], f["cost"], f["remedy"]


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """The first cell of a row is its class."""
    head = "".join(f"<th>{escape(h)}</th>" for h in heads)
    lines = []
    for kind, *cells in rows:
        lines.append(f'<tr class="{escape(kind)}">{"".join(f"<td>{escape(cell)}</td>" for cell in cells)}</tr>')
    return f"<table>{f'<tr>{head}</tr>' if head else ''}{''.join(lines)}</table>"


def _us(value: float) -> str:
    return f"{value:.4g} µs" if value < LONG_US else f"{value * 1e-3:.4g} ms"


def _shown(value: Any) -> str:
    if value is None:
        return UNKNOWN
    return f"{value:.6g}" if isinstance(value, float) else str(value)
