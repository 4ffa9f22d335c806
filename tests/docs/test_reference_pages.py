"""The reference pages are those of the tables, and the check sees when they are not."""

import shutil

import pytest

from rtctl.reference.__main__ import DIRECTORY, outdated
from rtctl.reference.markdown import blanks, table
from rtctl.reference.pages import PAGES


@pytest.fixture
def copy(tmp_path):
    for name, page in PAGES.items():
        (tmp_path / name).write_text(page())
    return tmp_path


def test_fresh_pages_are_up_to_date(copy):
    assert outdated(copy) == []
    shutil.copy(DIRECTORY / "README.md", copy)
    assert outdated(copy) == []


def test_a_changed_a_missing_and_a_left_over_page_are_seen(copy):
    page = copy / "settings.md"
    page.write_text(page.read_text().replace("`0.001`", "`0.002`", 1))
    (copy / "keys.md").unlink()
    (copy / "old.md").write_text("")
    assert outdated(copy) == ["keys.md", "old.md", "settings.md"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("settings.md", ["`period_s`", "`[backend.options.inject]` of `plant`", "`determinant_min_mm`", "`[robot.geometry]` of `planar_3rpr`"]),
        ("signals.md", ["`wrench_in_base`", "f8[6]", "What the backend `plant` knows", "`array_tip_in_base_mm`"]),
        ("commands.md", ["`servo_cv`", "DISABLED, ENABLED", "`outside_box`", "holder of the lease"]),
        ("conditions.md", ["`force_limit`", "PAUSE", "| open |", "force *value* N exceeds *bound* N"]),
        ("keys.md", ["`lease/acquire`", "`measured_cp`", "published"]),
        ("plan-file.md", ["`pose_in_cochlea_mm_rad`", "`depths`", "rtctl insertion plan", "3.2 .. 4.6 mm"]),
        ("summary.md", ["`insertion_force_mean_n`", "`lost_records`"]),
        ("cli.md", ["## `rtctl log recover`", "`--no-gateway`", "| 5 | the controller is in fault |"]),
    ],
)  # fmt: skip
def test_pages_say_what_people_look_up(name, words):
    text = PAGES[name]()
    assert [word for word in words if word not in text] == []


def test_cells_keep_the_table_whole():
    text = table(("a", "b"), [("x | y", "one\ntwo"), ("<name>", "`<name>`")])
    assert text.splitlines()[2:] == ["| x \\| y | one two |", "| &lt;name> | `<name>` |"]


def test_numbers_of_a_message_become_words():
    assert blanks("force {value:.3g} N exceeds {bound:.3g} N") == "force *value* N exceeds *bound* N"
