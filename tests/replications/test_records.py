"""The ledger of replications: what a record must have, how a file is written, when two runs disagree."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from pendulab import stream
from pendulab.replications import REPLICATIONS, __main__, records
from pendulab.replications.records import Record

GOOD = Record(
    *("muzaffari2024", "Table 1, row 0.01", "listing", "RMSE of θ1", "rad"),
    *(0.1, 0.2, 0.01, 10, "holds", "it does"),
)


@pytest.mark.parametrize(
    "wrong, said",
    [
        (dict(verdict="true"), "verdict 'true' is none of"),
        (dict(reason=""), "nothing said in reason"),
        (dict(ours=np.nan), "ours is nan"),
        (dict(standard_error=np.inf), "standard_error is inf"),
        (dict(runs=1), "1 runs; a standard error needs at least two"),
        (dict(runs=0, standard_error=None), "0 runs"),
    ],
)
def test_a_record_that_says_too_little_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        replace(GOOD, **wrong)


def test_a_file_gives_back_its_records(tmp_path):
    first = replace(GOOD, ours=np.float64(0.3), runs=np.int64(4))
    many = [first, replace(GOOD, quantity="RMSE of θ2", printed=None)]
    records.write(many, tmp_path / "a.json")
    assert records.read(tmp_path / "a.json") == many
    rows = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert isinstance(rows, list) and set(rows[0]) == set(Record.__dataclass_fields__)
    assert rows[1]["printed"] is None and rows[0]["ours"] == 0.3 and rows[0]["runs"] == 4


def test_nothing_is_lost_when_a_file_cannot_be_written(tmp_path, monkeypatch):
    file = tmp_path / "a.json"
    records.write([GOOD], file)
    before = file.read_bytes()
    with pytest.raises(ValueError, match="two records of one item"):
        records.write([GOOD, replace(GOOD, ours=3.0)], file)

    def half(rows, out, **options):
        out.write("[{")
        raise OSError("no space left")

    monkeypatch.setattr(records.json, "dump", half)
    with pytest.raises(OSError, match="no space"):
        records.write([GOOD], file)
    assert file.read_bytes() == before and list(tmp_path.iterdir()) == [file]


def test_a_file_of_something_else_is_refused(tmp_path):
    (tmp_path / "a.json").write_text('[{"document": "x"}]')
    with pytest.raises(ValueError, match="is no ledger"):
        records.read(tmp_path / "a.json")


def test_runs_disagree_where_chance_does_not_explain_it():
    same = replace(GOOD, ours=0.21, standard_error=0.02)
    assert records.disagreements([GOOD], [same]) == []
    for other in (
        replace(GOOD, ours=0.3),
        replace(GOOD, verdict="does not hold"),
        replace(GOOD, ours=None),
        replace(GOOD, ours=0.20001, standard_error=None),
        replace(GOOD, quantity="RMSE of θ2"),
    ):
        exact = replace(GOOD, standard_error=None)
        assert records.disagreements([GOOD if other.standard_error else exact], [other]), other


def test_the_bound_alarms_as_often_as_it_says():
    """400 tables of 20 cells, of runs like the printed one: about one in ten has a cell beyond the bound."""
    rng = stream("records/bound")
    alarms = 0
    for _ in range(400):
        found, printed = rng.normal(2, 3, (500, 20)), rng.normal(2, 3, 20)
        alarms += np.abs(records.standardised(found, printed)).max() > records.bound(20, 0.1)
    assert 20 < alarms < 62  # binomial of 400 and 0.1, four deviations


def test_rounding_of_the_printed_number_is_allowed_for():
    found = np.array([[1.0], [1.0001]])
    assert abs(records.standardised(found, np.array([1.04]))) > 100
    assert abs(records.standardised(found, np.array([1.04]), rounding=0.1)) < 2


def test_every_document_has_replications_that_the_command_runs(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(__main__, "collect", lambda names, full, *others: [GOOD] if full else [])
    assert __main__.main(["--json", str(tmp_path / "a.json"), "--full", "--document", "ukfslides"]) == 0
    assert records.read(tmp_path / "a.json") == [GOOD] and "1 records" in capsys.readouterr().out
    assert all(own and all(map(callable, own)) for own in REPLICATIONS.values())


def test_a_failed_replication_leaves_the_file_as_it_was(tmp_path, capsys, monkeypatch):
    def fails(*arguments):
        raise RuntimeError("1 of 2 replications failed: a.b")

    monkeypatch.setattr(__main__, "collect", fails)
    assert __main__.main(["--json", str(tmp_path / "a.json")]) == 1
    assert "was not written" in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_wrong_arguments_are_refused_in_words(tmp_path, capsys):
    no_folder = [str(tmp_path / "no" / "a.json")], "there is no folder"
    for wrong, said in no_folder, (["a.json", "--jobs=0"], "at least one"):
        with pytest.raises(SystemExit):
            __main__.main(["--json", *wrong])
        assert said in capsys.readouterr().err


def test_the_command_runs_one_replication_in_a_process_of_its_own(tmp_path):
    command = [sys.executable, "-m", "pendulab.replications", "--json", str(tmp_path / "a.json")]
    command += ["--document", "islamnd", "--only"]
    done = subprocess.run([*command, "equations"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = records.read(tmp_path / "a.json")
    assert found and {record.document for record in found} == {"islamnd"}
    assert f"{len(found)} records" in done.stdout and "islamnd.equations" in done.stderr
    none = subprocess.run([*command, "nothing"], capture_output=True, text=True)
    assert none.returncode == 1 and "no replication of islamnd is called 'nothing'" in none.stderr
