"""A certificate: whole or refused, for this machine or not, and named by the logs."""

import copy
import json

import pytest

from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.exchange.control import Grade
from rtctl.gateway.setup import header_of
from rtctl.readiness import certificate
from rtctl.readiness.certificate import CertificateError
from rtctl.readiness.facts import Facts
from rtctl.settings import config_hash, load


@pytest.fixture
def settings(tmp_path):
    return load("planar-sim", [f'log.directory="{tmp_path}"'])


def document_of(settings, **changes):
    """What every certificate has, for this machine and these settings."""
    content = {
        "format": certificate.FORMAT,
        "complete": True,
        "robot": settings.robot.name,
        "begun": "2031-02-03T04:05:06+00:00",
        "machine": certificate.machine(),
        "config_hash": config_hash(settings),
        "kernel_hash": certificate.kernel_hash(),
        "verdict": "kept",
        "verdicts": [{"name": "missed ticks", "bound": 0, "unit": "ticks", "measured": 0, "kept": True}],
        "tick": {"percentiles_us": {"p50": 2.5}},
    }
    return certificate.sealed(content | changes)


def leaves(value, path=()):
    """Path of every plain value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    found = [leaf for key, inner in items for leaf in leaves(inner, (*path, key))]
    return found or [path]


def test_what_was_written_is_read_again(settings):
    document = document_of(settings)
    paths = [certificate.write(document, certificate.folder_of(settings)) for _ in range(2)]
    assert len(set(paths)) == 2, "nothing is overwritten"
    assert [certificate.read(path) for path in paths] == [document, document]


def test_no_value_can_be_changed_unseen(settings, tmp_path):
    document = document_of(settings)
    for path in leaves(document):
        changed = copy.deepcopy(document)
        place = changed
        for key in path[:-1]:
            place = place[key]
        value = place[path[-1]]
        place[path[-1]] = (not value) if isinstance(value, bool) else value + 1 if isinstance(value, int | float) else f"{value}0"  # fmt: skip
        file = tmp_path / "changed.json"
        file.write_text(json.dumps(changed))
        with pytest.raises(CertificateError):
            certificate.read(file)


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", "null", '{"format": "rtctl certificate 1"}', "[" * 100_000, "\xff", '{"format": 1e999}',
     '{"format": "another 1", "sha256": ""}'],
)  # fmt: skip
def test_what_is_no_certificate_is_refused_and_passed_over(settings, text):
    folder = certificate.folder_of(settings)
    good = certificate.write(document_of(settings), folder)
    bad = folder / "planar-9999.json"
    bad.write_bytes(text.encode("latin-1"))
    with pytest.raises(CertificateError):
        certificate.read(bad)
    assert certificate.newest(settings)[0] == good


def test_numbers_that_json_has_not_are_refused(settings, tmp_path):
    file = tmp_path / "nan.json"
    for number in ("NaN", "Infinity", "1e999"):
        text = json.dumps(document_of(settings, tick=7)).replace('"tick": 7', f'"tick": {number}')
        file.write_text(text)
        with pytest.raises(CertificateError):
            certificate.read(file)


def test_the_newest_that_fits_is_named_by_the_logs(settings):
    folder = certificate.folder_of(settings)
    fitting = document_of(settings, begun="2031-02-03T04:05:06+00:00", verdict="not kept")
    for document in (
        document_of(settings, begun="2030-01-01T00:00:00+00:00"),
        fitting,
        document_of(settings, begun="2032-01-01T00:00:00+00:00", complete=False),
        document_of(settings, begun="2033-01-01T00:00:00+00:00", kernel_hash="0123456789abcdef"),
        document_of(settings, begun="2034-01-01T00:00:00+00:00", config_hash="0123456789abcdef"),
        document_of(settings, begun="2035-01-01T00:00:00+00:00", machine={"id": "another"}),
    ):
        certificate.write(document, folder)
    assert certificate.newest(settings)[1] == fitting
    assert header_of(settings, 1, Grade.RT, 0)["certificate"] == fitting["sha256"]
    assert header_of(settings, 1, Grade.SIM, 0)["certificate"] == "", "lockstep keeps no time"
    other = load("planar-sim", [f'log.directory="{settings.log.directory}"', "loop.priority=70"])
    assert header_of(other, 1, Grade.RT, 0)["certificate"] == ""


def test_a_machine_is_told_by_what_it_tells(tmp_path):
    silent = certificate.machine(Facts(tmp_path))
    assert silent["id"] is None
    assert silent["processor"] is None
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc/machine-id").write_text("0123456789abcdef0123456789abcdef\n")
    told = certificate.machine(Facts(tmp_path))
    assert told != silent
    assert "0123456789abcdef" not in json.dumps(told), "the id itself is nobody's business"


def test_a_folder_that_cannot_be_written_is_said(settings, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CertificateError, match="cannot be written"):
        certificate.write(document_of(settings), tmp_path / "file")


def test_a_certificate_that_does_not_fit_is_told_by_its_exit_code(settings, tmp_path, capsys):
    bare = {"load": {"what": ""}, "loop": {"grade": "rt"}, "reference": {"obstacle": ""}}
    path = certificate.write(document_of(settings, **bare), tmp_path)
    own = ["--set", f'log.directory="{tmp_path}"']
    assert main(["certify", "planar-sim", "--check", str(path), *own]) == Exit.OK
    assert main(["certify", "planar-sim", "--check", str(path), *own, "--set", "loop.priority=70"]) == Exit.DATA
    assert "other settings" in capsys.readouterr().err
    path.write_text(path.read_text().replace('"kept": true', '"kept": false'))
    assert main(["certify", "planar-sim", "--check", str(path), *own]) == Exit.DATA
    assert "was changed" in capsys.readouterr().err
