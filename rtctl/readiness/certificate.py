"""A certificate as a file: what it holds, the hash over all of it, and whether it fits this machine and these settings."""

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hal.errors import RtctlError
from hal.kernel import kernel_hash
from rtctl.readiness.facts import Facts, Unreadable
from rtctl.settings import Settings, config_hash

FORMAT = "rtctl certificate 1"
FOLDER = "certificates"
HASH = "sha256"
PURPOSE = b"rtctl certificate"
REQUIRED = {"format": str, HASH: str, "complete": bool, "robot": str, "begun": str, "machine": dict, "config_hash": str, "kernel_hash": str, "verdict": str, "verdicts": list}  # fmt: skip


class CertificateError(RtctlError):
    """A certificate cannot be written, read or trusted."""

    exit_code = 6


def folder_of(settings: Settings) -> Path:
    """Where certificates are kept: beside the runs."""
    return Path(settings.log.directory) / FOLDER


def sealed(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content with the hash over all of it."""
    return {**content, HASH: hash_of(content)}


def hash_of(document: Mapping[str, Any]) -> str:
    """SHA-256 (64 hex digits) over everything but the hash itself, in one way of writing it."""
    content = {name: value for name, value in document.items() if name != HASH}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def write(document: Mapping[str, Any], folder: Path) -> Path:
    """Put a sealed document into a file of its own in the folder. Raises CertificateError."""
    stem = f"{document['robot']}-{document['begun'][:19].replace(':', '-')}"
    path, number = folder / f"{stem}.json", 1
    while path.exists():
        number += 1
        path = folder / f"{stem}-{number}.json"
    partial = path.with_suffix(".part")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        partial.write_text(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")
        partial.rename(path)  # whole or not there
    except OSError as error:
        raise CertificateError("the certificate cannot be written", value=str(path), remedy=str(error.strerror)) from None  # fmt: skip
    return path


def read(path: Path) -> dict[str, Any]:
    """The document in a file. Raises CertificateError if it is none, or not as it was written."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_number)
    except OSError as error:
        raise CertificateError("the certificate cannot be read", value=str(path), remedy=str(error.strerror)) from None
    except (ValueError, RecursionError):
        raise CertificateError("this file is no certificate", value=str(path), bound="JSON of `rtctl certify`") from None  # fmt: skip
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise CertificateError("this file is no certificate", value=str(path), bound=FORMAT)
    wrong = [name for name, kind in REQUIRED.items() if not isinstance(document.get(name), kind)]
    if wrong:
        raise CertificateError(f"{', '.join(wrong)} of the certificate is not what it should be", value=str(path))
    try:
        found = hash_of(document)
    except (ValueError, RecursionError):  # numbers or letters that `write` would never write
        found = "none"
    if found != document[HASH]:
        raise CertificateError("the certificate was changed after it was written", value=str(path), bound=f"{HASH} {document[HASH]}", remedy="certify anew")  # fmt: skip
    return document


def newest(settings: Settings, facts: Facts | None = None) -> tuple[Path, dict[str, Any]] | None:
    """The newest complete certificate for this machine, these settings and these kernels; None without one.

    Whatever else lies in the folder is passed over.
    """
    found = []
    for path in folder_of(settings).glob(f"{settings.robot.name}-*.json"):
        try:
            document = read(path)
        except CertificateError:
            continue
        if document["complete"] and not misfits(document, settings, facts):
            found.append((document["begun"], path, document))
    return max(found, key=lambda entry: entry[:2])[1:] if found else None


def newest_hash(settings: Settings) -> str:
    """Its hash for the header of a log; empty without one."""
    found = newest(settings)
    return found[1][HASH] if found else ""


def misfits(document: Mapping[str, Any], settings: Settings, facts: Facts | None = None) -> list[str]:
    """What a certificate was made for and does not hold here; empty if it fits."""
    here = {"machine": machine(facts), "config_hash": config_hash(settings), "kernel_hash": kernel_hash()}
    words = {"machine": "machine or its kernel", "config_hash": "settings", "kernel_hash": "compiled kernels of rtctl"}
    return [
        f"other {words[name]}: {_shown(document[name])}, here {_shown(value)}"
        for name, value in here.items()
        if document[name] != value
    ]


def machine(facts: Facts | None = None) -> dict[str, Any]:
    """Which machine this is: what changes its timing. None where it does not tell.

    The id of the machine is not to be told to others (machine-id(5)): this is a hash that serves no other purpose.
    """
    facts = facts or Facts()
    machine_id = _told(facts, "etc/machine-id")
    lines = (_told(facts, "proc/cpuinfo") or "").splitlines()
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), None)
    return {
        "id": machine_id and hashlib.sha256(PURPOSE + machine_id.encode()).hexdigest()[:16],
        "processor": model,
        "cores": os.cpu_count(),
        "kernel": f"{platform.release()} {platform.version()}",
    }


def _told(facts: Facts, path: str) -> str | None:
    try:
        return facts.text(path) or None
    except Unreadable:
        return None


def _no_number(text: str) -> float:
    raise ValueError(text)


def _shown(value: Any) -> str:
    if not isinstance(value, dict):
        return str(value)
    return ", ".join("unknown" if v is None else str(v) for v in value.values())
