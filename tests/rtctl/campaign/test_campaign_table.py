"""The table on disk: whole lines or none, only its own campaign's, and nothing of anybody else's is touched."""

import csv

import pytest

from rtctl.campaign.table import CampaignError, Table

COLUMNS = ("seed", "outcome", "failure", "config_hash", "kernel_hash")
IDENTITY = {"config_hash": "c0", "kernel_hash": "k0"}


def row(seed, **values):
    return {"seed": str(seed), "outcome": "completed"} | IDENTITY | values


@pytest.fixture
def path(tmp_path):
    """A table of three rows."""
    file = tmp_path / "table.csv"
    with Table(file, COLUMNS, IDENTITY) as table:
        assert table.known == {}
        for seed in (4, 5, 6):
            table.append(row(seed, failure='insert: "no", 3 mN; pull'))
    return file


def seeds(path):
    with Table(path, COLUMNS, IDENTITY) as table:
        return list(table.known)


def test_rows_come_back_as_they_were_and_any_reader_of_csv_reads_them(path):
    with Table(path, COLUMNS, IDENTITY) as table:
        assert table.known == {s: row(s, failure='insert: "no", 3 mN; pull') for s in (4, 5, 6)}
    assert [r["seed"] for r in csv.DictReader(path.read_text().splitlines())] == ["4", "5", "6"]


def test_a_row_is_on_disk_as_soon_as_it_is_written(path):
    with Table(path, COLUMNS, IDENTITY) as table:
        table.append(row(7))
        assert path.read_bytes().endswith(b"7,completed,,c0,k0\n")


def test_wherever_the_writing_was_cut_whole_rows_stay_and_the_rest_is_written_anew(path):
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        kept = max(whole[:length].count(b"\n") - 1, 0)
        with Table(path, COLUMNS, IDENTITY) as table:
            assert list(table.known) == [4, 5, 6][:kept]
            for seed in (4, 5, 6)[kept:]:
                table.append(row(seed, failure='insert: "no", 3 mN; pull'))
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    ("name", "text"), [("config_hash", "with other settings"), ("kernel_hash", "by another version of the program")]
)
def test_the_table_of_another_campaign_is_refused_and_left_alone(path, name, text):
    with path.open("ab") as file:
        file.write(b"7,comp")
    before = path.read_bytes()
    with pytest.raises(CampaignError, match=rf"begun {text} .*got '.0' \(allowed: new\); name another file") as caught:
        Table(path, COLUMNS, IDENTITY | {name: "new"})
    assert caught.value.exit_code == 6
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"dear diary\n", "holds something else"),
        (b"seed,outcome\n1,completed\n", "columns of another version"),
        (b"dear", "holds something else"),
        (b"seed,outcome,failure,config_hash,kernel_hash\n4,completed,c0,k0\n", "line 2 of the file is not a row"),
        (b"seed,outcome,failure,config_hash,kernel_hash\nx,completed,,c0,k0\n", "line 2 of the file is not a row"),
        (b"seed,outcome,failure,config_hash,kernel_hash\n\xff\n", "line 2 of the file is not a row"),
        (b"seed,outcome,failure,config_hash,kernel_hash\n\n", "line 2 of the file is not a row"),
    ],
)
def test_what_is_not_a_table_is_refused_and_left_alone(tmp_path, content, reason):
    file = tmp_path / "diary.txt"
    file.write_bytes(content)
    with pytest.raises(CampaignError, match=reason):
        Table(file, COLUMNS, IDENTITY)
    assert file.read_bytes() == content


def test_two_campaigns_do_not_write_into_one_file(path):
    with Table(path, COLUMNS, IDENTITY), pytest.raises(CampaignError, match="another campaign is writing"):
        Table(path, COLUMNS, IDENTITY)
    assert seeds(path) == [4, 5, 6]


@pytest.mark.parametrize("place", ["/dev/null", "nowhere/table.csv", "."])
def test_places_that_hold_no_file_are_refused(tmp_path, monkeypatch, place):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CampaignError, match="name another file"):
        Table(tmp_path / place, COLUMNS, IDENTITY)


def test_a_full_disk_is_an_error_and_what_was_written_stays(path, monkeypatch):
    class Full:
        def __init__(self, file):
            self.file, self.close = file, file.close

        def write(self, line):
            return self.file.write(line[:7])

    with Table(path, COLUMNS, IDENTITY) as table:
        monkeypatch.setattr(table, "_file", Full(table._file))
        with pytest.raises(CampaignError, match="run the same command again"):
            table.append(row(7))
    assert path.read_bytes().endswith(b"\n7,compl")
    assert seeds(path) == [4, 5, 6]
