"""The report page: whole, alone, and true to the summary."""

import dataclasses
import json
from html.parser import HTMLParser

import numpy as np
import pytest

from rtctl import report
from rtctl.lifecycle import Condition, Operating
from rtctl.log.format import LogError

VOID = {"meta", "br", "img", "link", "input"}


class Reader(HTMLParser):
    """Checks that tags are balanced and collects what the tests look at."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.svgs = 0
        self.text = ""

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        self.svgs += tag == "svg"
        self.references += [v for k, v in attrs if k in ("src", "href", "xlink:href") and not v.startswith("#")]

    def handle_startendtag(self, _tag, attrs):
        self.references += [v for k, v in attrs if k in ("src", "href", "xlink:href") and not v.startswith("#")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def read(path) -> Reader:
    reader = Reader()
    reader.feed(path.read_text(encoding="utf-8"))
    assert reader.open == []
    return reader


def test_report_of_a_run_folder_is_one_page_with_its_pictures(insertion, tmp_path):
    (tmp_path / "log.mcap").write_bytes(insertion.log.read_bytes())
    figures = report.write(tmp_path)
    page = read(tmp_path / "report.html")
    assert page.references == [], "nothing is fetched from anywhere"
    assert page.svgs == 4, "there is no timing in lockstep"
    assert "Insertion completed: 4.0 mm with robot planar" in page.text
    assert "lockstep run has a virtual clock" in page.text
    assert figures["config_hash"] in page.text
    assert "home accepted" in page.text
    assert "insertion_force_mean_n" in page.text
    assert json.loads((tmp_path / "summary.json").read_text()) == figures
    pictures = sorted(p.name for p in (tmp_path / "figures").iterdir())
    assert pictures == ["cochlea.png", "force.png", "motion.png", "path.png"]
    assert all((tmp_path / "figures" / name).read_bytes().startswith(b"\x89PNG") for name in pictures)


def test_same_run_gives_the_same_page(insertion, tmp_path):
    recording = insertion.simulation.recording
    for name in ("a", "b"):
        report.render(recording, tmp_path / name, figures=False)
    assert (tmp_path / "a" / "report.html").read_bytes() == (tmp_path / "b" / "report.html").read_bytes()


def test_real_timing_gets_its_histograms(insertion):
    records = insertion.simulation.recording.records.copy()
    records["tick_ns"], records["lateness_ns"] = 20_000, 10_000
    records["lateness_ns"][5] = 40_000_000
    drawn = report.draw(dataclasses.replace(insertion.simulation.recording, records=records))
    assert "timing" in [name for name, *_ in drawn]


def test_a_fault_before_the_insertion_is_told_on_top_with_its_remedy(insertion, tmp_path):
    records = insertion.simulation.recording.records[:3000].copy()
    records["operating_state"][-100:] = Operating.FAULT
    records["fault_cause"][-100:] = Condition.FOLLOWING_ERROR
    records["condition_active"][-100] = 1 << Condition.FOLLOWING_ERROR
    records["condition_reported"][-100] = Condition.FOLLOWING_ERROR
    records["condition_value"][-100], records["condition_bound"][-100] = 6.5, 6.0
    broken = dataclasses.replace(insertion.simulation.recording, records=records, truths=None)
    figures = report.render(broken, tmp_path, figures=False)
    page = read(tmp_path / "report.html")
    assert figures["outcome"] == "fault"
    assert "Insertion ended in a fault" in page.text
    assert "a motor is 6.5 rad from its reference (limit 6)." in page.text
    assert "look for a jam or a cut wire" in page.text
    assert page.svgs == 0


def test_hardware_has_no_truth_and_its_report_says_nothing_of_it(insertion, tmp_path):
    report.render(dataclasses.replace(insertion.simulation.recording, truths=None), tmp_path, figures=False)
    page = read(tmp_path / "report.html")
    assert page.svgs == 4
    assert "truly are" not in page.text


def test_texts_from_outside_are_text(insertion, tmp_path):
    event = {"time_ns": 0, "tick": 0, "kind": "lease", "text": "<script>alert(1)</script> holds the lease"}
    recording = dataclasses.replace(insertion.simulation.recording, events=[event])
    report.render(recording, tmp_path, figures=False)
    assert "<script" not in (tmp_path / "report.html").read_text()


def test_plants_that_tell_less_are_reported_all_the_same(insertion):
    poor = np.zeros(len(insertion.simulation.recording.records), [("time_ns", "u8"), ("tick", "i8")])
    poor["tick"] = insertion.simulation.recording.records["tick"]
    assert len(report.draw(dataclasses.replace(insertion.simulation.recording, truths=poor))) == 4


def test_a_folder_without_logs_is_refused(tmp_path):
    with pytest.raises(LogError, match="no log in the folder"):
        report.write(tmp_path)
