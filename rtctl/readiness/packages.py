"""The installed packages against what rtctl asks for."""

from importlib import metadata

from packaging.requirements import Requirement

from rtctl.readiness.finding import Finding, costs, good, unknown

NAME = "rtctl"


def versions() -> list[Finding]:
    """One finding: all fit, or one for each package that does not."""
    try:
        asked = [Requirement(text) for text in metadata.requires(NAME) or ()]
    except metadata.PackageNotFoundError:
        return [unknown("packages", "rtctl is not installed as a package", "make")]
    wanted = [r for r in asked if r.marker is None or r.marker.evaluate()]
    wrong = [found for requirement in wanted if (found := _fits(requirement)) is not None]
    return wrong or [good("packages", f"{len(wanted)} as asked for; numba {metadata.version('numba')}, numpy {metadata.version('numpy')}, zenoh {metadata.version('eclipse-zenoh')}")]  # fmt: skip


def _fits(requirement: Requirement) -> Finding | None:
    name, remedy = f"package {requirement.name}", "make clean && make"
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return costs(name, "is not installed", "what needs it does not start", remedy)
    if requirement.specifier.contains(version, prereleases=True):
        return None
    return costs(name, f"{version}, asked for is {requirement.specifier}", "rtctl was never tested with it", remedy)
