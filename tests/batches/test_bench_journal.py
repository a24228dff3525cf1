"""The journal: whole lines only, one writer, nothing lost silently."""

from __future__ import annotations

import json
import resource
import signal

import pytest

from energy_opt.batches.records import NAME, Journal, read_journal
from energy_opt.errors import BadInput
from energy_opt.files import write_text

HEADER = {"suite": "s", "digest": "d"}


def record(key):
    return {"key": key, "row": {"status": "solved", "duration": 0.1}, "worker": {}}


def fill(folder, keys):
    with Journal(folder, HEADER, resume=False) as journal:
        for key in keys:
            journal.append(record(key))


def test_written_results_are_read(tmp_path):
    fill(tmp_path, "abc")
    header, records, whole = read_journal(tmp_path / NAME)
    assert (header["suite"], [r["key"] for r in records]) == ("s", ["a", "b", "c"])
    assert whole == (tmp_path / NAME).stat().st_size


@pytest.mark.parametrize("cut", [1, 5, 30])
def test_a_torn_last_line_is_left_out_and_overwritten(tmp_path, cut):
    fill(tmp_path, "abc")
    path = tmp_path / NAME
    path.write_bytes(path.read_bytes()[:-cut])
    with Journal(tmp_path, HEADER, resume=True) as journal:
        assert [r["key"] for r in journal.records] == ["a", "b"]
        journal.append(record("c"))
    assert [r["key"] for r in read_journal(path)[1]] == ["a", "b", "c"]
    assert all(json.loads(line) for line in path.read_text().splitlines())


def test_a_full_disk_names_the_file_and_keeps_the_records(tmp_path):
    fill(tmp_path, "abc")
    limits, before = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, ((tmp_path / NAME).stat().st_size + 10, limits[1]))
    try:
        said = r"results\.jsonl: cannot be written: File too large; .* resume runs the other moves"
        with pytest.raises(BadInput, match=said), Journal(tmp_path, HEADER, resume=True) as journal:
            journal.append(record("d"))
        with pytest.raises(OSError, match=r"x\.txt"):
            write_text(tmp_path / "x.txt", "x" * 10_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, before)
    assert [r["key"] for r in read_journal(tmp_path / NAME)[1]] == ["a", "b", "c"]


def test_every_possible_death_can_be_resumed(tmp_path):
    fill(tmp_path, "ab")
    path = tmp_path / NAME
    content = path.read_bytes()
    for length in range(len(content) + 1):
        path.write_bytes(content[:length])
        with Journal(tmp_path, HEADER, resume=True) as journal:
            keys = [r["key"] for r in journal.records]
            assert keys == ["a", "b"][: max(content[:length].count(b"\n") - 1, 0)]


def test_damage_before_the_last_line_is_named(tmp_path):
    fill(tmp_path, "abc")
    path = tmp_path / NAME
    lines = path.read_text().splitlines()
    lines[2] = lines[2][:10]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(BadInput, match=r"row 3: not a line of JSON"), Journal(tmp_path, HEADER, resume=True):
        pass


def test_foreign_file_is_not_touched(tmp_path):
    path = tmp_path / NAME
    path.write_text('{"some": "thing"}\n')
    with pytest.raises(BadInput, match="not a journal"), Journal(tmp_path, HEADER, resume=False):
        pass
    assert path.read_text() == '{"some": "thing"}\n'


def test_unfinished_batch_is_not_overwritten(tmp_path):
    fill(tmp_path, "ab")
    with pytest.raises(BadInput, match="add resume"), Journal(tmp_path, HEADER, resume=False):
        pass
    (tmp_path / "summary.json").write_text('{"complete": false}')
    with pytest.raises(BadInput, match="add resume"), Journal(tmp_path, HEADER, resume=False):
        pass
    (tmp_path / "summary.json").write_text('{"complete": true}')
    with Journal(tmp_path, HEADER, resume=False) as journal:
        assert journal.records == []


def test_one_writer(tmp_path):
    with (
        Journal(tmp_path, HEADER, resume=False),
        pytest.raises(BadInput, match="another batch"),
        Journal(tmp_path, HEADER, resume=True),
    ):
        pass


def test_results_of_another_suite_are_not_overwritten(tmp_path):
    with Journal(tmp_path, {"suite": "a"}, resume=False) as journal:
        journal.append({"key": "k", "row": {}})
    (tmp_path / "summary.json").write_text('{"complete": true}')
    with pytest.raises(BadInput, match=r"suite 'a'.*add force"):
        Journal(tmp_path, {"suite": "b"}, resume=False)
    with Journal(tmp_path, {"suite": "b"}, resume=False, force=True) as journal:
        assert journal.records == []


def test_results_of_another_version_of_a_suite_are_not_overwritten(tmp_path):
    fill(tmp_path, "a")
    (tmp_path / "summary.json").write_text('{"complete": true}')
    edited = {**HEADER, "digest": "e"}
    with pytest.raises(BadInput, match=r"suite 's' as it was.*add force"):
        Journal(tmp_path, edited, resume=False)
    with Journal(tmp_path, edited, resume=True) as journal:
        assert len(journal.records) == 1
    with Journal(tmp_path, edited, resume=False, force=True) as journal:
        assert journal.records == []
