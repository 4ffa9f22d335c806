"""``rtctl detector``: train and judge what recognises buckling and tip folding."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.console import grid, output, remark, say
from rtctl.cli.options import JSON, RECORDS

if TYPE_CHECKING:
    from rtctl.guidance.dataset import Dataset
    from rtctl.guidance.evaluation import Evaluation

SYNTHETIC = "SYN-1"
DATA = Annotated[
    list[str], typer.Argument(help=f"Folders of logs, or {SYNTHETIC} for made-up insertions.", metavar="DATA...")
]
DATA_SEED = Annotated[int, typer.Option(help=f"Seed of {SYNTHETIC}, and of the splits.", min=0)]
TRAINING_SET, TEST_SET = (51, 56, 0), (300, 300, 300)
"""Normal, folding and buckling insertions of SYN-1."""
MARGINS = (0.0, 0.25, 0.5, 0.75, 1.0)


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="Train and judge the detectors of buckling and tip folding.", no_args_is_help=True)
    group.command()(train)
    group.command()(evaluate)
    app.add_typer(group, name="detector", rich_help_panel=RECORDS)


def train(
    data: DATA,
    to: Annotated[Path, typer.Option(help="The detector, a JSON file.", dir_okay=False)],
    method: Annotated[int, typer.Option(min=1, max=2, help="1: features of f_z; 2: of f_z, f_xx and f_yy.")] = 2,
    seed: DATA_SEED = 0,
) -> None:
    """Train a detector on insertions of which it is known how they ended.

    Example: `rtctl detector train SYN-1 --to syn-1.json`
    """
    from rtctl.guidance import detector_file, training

    found = _dataset(data, seed, TRAINING_SET)
    detector = training.train(found, method=method, reference_forces=data == [SYNTHETIC])
    detector_file.write(detector, to)
    counts = ", ".join(f"{count} {name}" for name, count in found.counts().items())
    say(f"{to}: trained on {found.name} ({counts}), digest {found.digest}")
    say(f"use it with --set guidance.detector={to}")


def evaluate(
    detector: Annotated[Path, typer.Argument(help="File of a detector.")],
    data: DATA,
    seed: DATA_SEED = 1,
    two_sided: Annotated[bool, typer.Option("--two-sided", help="Low forces count as buckling, too.")] = False,
    splits: Annotated[
        int, typer.Option(min=0, max=10000, help="Random 90/10 splits to compare all methods in; 0 for none.")
    ] = 50,
    json: JSON = False,
) -> None:
    """Judge a detector on insertions: confusion by class, errors and onset for several margins.

    With --splits every method of Table VI.4 is trained and tested anew on parts of the same insertions.

    Example: `rtctl detector evaluate syn-1.json SYN-1 --seed 7`
    """
    import json as encoder

    from rtctl.guidance import detector_file, evaluation

    judged = detector_file.load(detector)
    found = _dataset(data, seed, TEST_SET)
    results = evaluation.evaluate(judged, found, MARGINS, two_sided)
    counts = found.counts()
    methods: dict[int, dict[str, Any]] = {}
    if splits and counts["normal"] > 1 and counts["fold"] > 1:
        for number, name in evaluation.METHODS.items():
            accuracy = evaluation.cross_validate(found, number, splits, seed)
            methods[number] = {"features": name, "accuracy": float(accuracy.mean()), "sd": float(accuracy.std())}
    if json:
        facts = {"data": found.name, "digest": found.digest, "counts": counts, "trained_on": judged.provenance}
        say(encoder.dumps(facts | {"margins": [r.as_table() for r in results], "methods": methods}, indent=2, ensure_ascii=False))  # fmt: skip
        return
    output().print(
        grid(
            {
                "detector": f"{detector}, method {judged.folding.method}",
                "trained on": judged.provenance.get("data", "?"),
                "judged on": f"{found.name}, digest {found.digest}",
            }
        )
    )
    _print(results, methods, splits)


def _dataset(data: list[str], seed: int, counts: tuple[int, int, int]) -> "Dataset":
    """Made-up insertions, or those in folders; tells what could not be used."""
    from hal.errors import OptionError
    from rtctl.guidance.dataset import collect, synthesise

    if data == [SYNTHETIC]:
        return synthesise(seed, *counts)
    folders = [Path(name) for name in data]
    for folder in folders:
        if not folder.is_dir():
            raise OptionError("this is no folder of logs", value=str(folder), remedy=f"give folders, or {SYNTHETIC}")
    found = collect(folders)
    for text in found.skipped:
        remark(f"left out {text}")
    return found


def _print(results: "list[Evaluation]", methods: dict[int, dict[str, Any]], splits: int) -> None:
    from rich.table import Table

    margins = Table("ρ", "false positives", "false negatives", "combined accuracy", "median onset", "before AOS", title="Tip folding", title_justify="left")  # fmt: skip
    for r in results:
        cells = (f"{r.margin:g}", *(f"{100 * v:.1f} %" for v in (r.false_positives, r.false_negatives, r.accuracy)))
        margins.add_row(*cells, f"{r.median_onset_mm:.1f} mm", f"{100 * r.early_share:.1f} %")
    output().print(margins)
    recommended = next(r for r in results if r.margin == 0.75)
    confusion = Table("insertions", "number", "flagged fold", "flagged buckling", "neither", title="Which are flagged as what, at ρ = 0.75", title_justify="left")  # fmt: skip
    for name, row in recommended.confusion.items():
        confusion.add_row(name, *(str(row[key]) for key in ("insertions", "fold", "buckling", "neither")))
    output().print(confusion)
    if methods:
        accuracy = Table("method", "features", "accuracy (SD)", title=f"Methods on whole insertions, {splits} random 90/10 splits of this data", title_justify="left")  # fmt: skip
        for number, facts in methods.items():
            accuracy.add_row(str(number), facts["features"], f"{facts['accuracy']:.3f} ({facts['sd']:.3f})")
        output().print(accuracy)
