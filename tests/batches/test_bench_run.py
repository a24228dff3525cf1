"""Batches survive failing moves, dying workers, SIGKILL and Ctrl-C, and do each move exactly once."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import bench_workers
import pytest

from energy_opt.batches import batch
from energy_opt.batches.batch import run_batch
from energy_opt.batches.executors import local, resident_memory
from energy_opt.batches.records import NAME, TIMES, read_journal, read_parquet
from energy_opt.batches.suite import load_suite

HERE = Path(__file__).parents[1]
COUNT = 12
SCRIPT = f"""
import sys
sys.path[:0] = [{str(HERE)!r}, {str(HERE.parent)!r}]
import bench_workers
from pathlib import Path
from energy_opt.batches.batch import run_batch
from energy_opt.batches.suite import load_suite
if __name__ == "__main__":
    batch = run_batch(load_suite(Path(sys.argv[1])), Path(sys.argv[2]), jobs=2, resume=True, solve=bench_workers.slow)
    sys.exit(130 if batch.interrupted else 0)
"""


@pytest.fixture
def suite_file(tmp_path):
    path = tmp_path / "suite.toml"
    path.write_text(
        'format = "energy-opt/suite/1"\nname = "s"\nrobots = ["panda"]\nmodes = ["retime"]\n'
        f"random = {{ count = {COUNT} }}\n"
    )
    return path


def untimed(rows):
    return [{name: value for name, value in row.items() if name not in TIMES} for row in rows]


def keys(out):
    return [record["key"] for record in read_journal(out / NAME)[1]]


def started(suite_file, out):
    script = suite_file.parent / "batch.py"
    script.write_text(SCRIPT)
    return subprocess.Popen([sys.executable, str(script), str(suite_file), str(out)], stderr=subprocess.PIPE)


def wait_for_lines(process, path, count):
    deadline = time.monotonic() + 60
    while not path.exists() or path.read_bytes().count(b"\n") < count:
        assert process.poll() is None, process.communicate()[1].decode()
        assert time.monotonic() < deadline, "the batch does not get on"
        time.sleep(0.01)


def test_order_of_workers_changes_nothing(suite_file, tmp_path):
    suite = load_suite(suite_file)
    one = run_batch(suite, tmp_path / "one", jobs=1, solve=bench_workers.known)
    two = run_batch(suite, tmp_path / "two", jobs=2, solve=bench_workers.slow)
    assert one.records == two.records
    assert [row["key"] for row in one.records] == [task.key for task in suite.tasks]
    assert untimed(read_parquet(tmp_path / "one" / "results.parquet")) == untimed(one.records)
    assert len({record["worker"]["process"] for record in read_journal(tmp_path / "two" / NAME)[1]}) == 2
    assert str(two).endswith(f"results in {tmp_path / 'two'}")  # Python said "in ."


@pytest.mark.slow
def test_killed_and_resumed_equals_uninterrupted(suite_file, tmp_path):
    suite = load_suite(suite_file)
    whole = run_batch(suite, tmp_path / "whole", jobs=2, solve=bench_workers.known)
    out = tmp_path / "killed"
    for lines in (3, 7):
        process = started(suite_file, out)
        wait_for_lines(process, out / NAME, lines)
        process.kill()
        process.communicate()
    with (out / NAME).open("ab") as stream:
        stream.write(b'{"key": "torn')  # what a death in the middle of a line leaves
    resumed = run_batch(suite, out, jobs=2, resume=True, solve=bench_workers.known)
    assert resumed.records == whole.records
    assert sorted(keys(out)) == sorted(task.key for task in suite.tasks)  # each exactly once
    assert resumed.summary["complete"]
    assert read_parquet(out / "results.parquet") == read_parquet(tmp_path / "whole" / "results.parquet")


def test_workers_do_not_outlive_a_killed_batch(suite_file, tmp_path):
    process = started(suite_file, tmp_path / "out")
    wait_for_lines(process, tmp_path / "out" / NAME, 4)
    pids = {record["worker"]["process"] for record in read_journal(tmp_path / "out" / NAME)[1]}
    process.kill()
    process.communicate()
    deadline = time.monotonic() + 20
    while any(Path(f"/proc/{pid}/cmdline").exists() and alive(pid) for pid in pids):
        assert time.monotonic() < deadline, "a worker is still there"
        time.sleep(0.05)


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
def test_ctrl_c_keeps_finished_moves(suite_file, tmp_path):
    out = tmp_path / "out"
    process = started(suite_file, out)
    wait_for_lines(process, out / NAME, 4)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    summary = json.loads((out / "summary.json").read_text())
    assert not summary["complete"]
    assert 3 <= len(read_parquet(out / "results.parquet")) < COUNT
    done = run_batch(load_suite(suite_file), out, jobs=1, resume=True, solve=bench_workers.known)
    assert done.summary["complete"]
    assert sorted(keys(out)) == sorted(row["key"] for row in done.records)


def test_ctrl_c_before_the_first_move_names_the_suite(suite_file, tmp_path, monkeypatch):
    monkeypatch.setattr(batch, "run_tasks", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    found = batch.run_batch(load_suite(suite_file), tmp_path)
    assert found.text().startswith(f"s: 0 of {COUNT} moves: none") and found.exit_code == 130


def test_a_move_that_raises_is_a_row(suite_file, tmp_path):
    batch = run_batch(load_suite(suite_file), tmp_path, jobs=2, solve=bench_workers.faulty)
    assert [row["status"] for row in batch.records] == ["solved"] * 2 + ["failed"] + ["solved"] * (COUNT - 3)
    assert batch.records[2]["error"] == "ZeroDivisionError: by nought"
    assert batch.summary["failures"][0]["error"] == "ZeroDivisionError: by nought"


@pytest.mark.slow
def test_a_move_that_kills_its_worker_is_a_row(suite_file, tmp_path):
    batch = run_batch(load_suite(suite_file), tmp_path, jobs=2, solve=bench_workers.deadly)
    assert [row["status"] for row in batch.records] == ["solved"] * 2 + ["failed"] + ["solved"] * (COUNT - 3)
    assert "worker process died" in batch.records[2]["error"]
    assert sorted(keys(tmp_path)) == sorted(row["key"] for row in batch.records)


@pytest.mark.slow
def test_a_worker_that_dies_once_costs_nothing(suite_file, tmp_path, monkeypatch):
    monkeypatch.setenv("BENCH_TEST_MARKER", str(tmp_path / "marker"))
    batch = run_batch(load_suite(suite_file), tmp_path / "out", jobs=2, solve=bench_workers.failing_once)
    assert all(row["status"] == "solved" for row in batch.records)


def test_resume_does_only_what_an_edited_suite_adds(suite_file, tmp_path):
    out = tmp_path / "out"
    run_batch(load_suite(suite_file), out, solve=bench_workers.known)
    suite_file.write_text(suite_file.read_text().replace(f"count = {COUNT}", f"count = {COUNT + 2}"))
    again = run_batch(load_suite(suite_file), out, resume=True, solve=bench_workers.known)
    assert again.summary["run"]["moves"] == 2
    assert len(again.records) == COUNT + 2
    suite_file.write_text(suite_file.read_text().replace(f"count = {COUNT + 2}", "count = 1"))
    fewer = run_batch(load_suite(suite_file), out, resume=True, solve=bench_workers.known)
    assert (len(fewer.records), fewer.left_out, fewer.summary["run"]["moves"]) == (1, COUNT + 1, 0)


def test_a_machine_without_proc_runs_batches(suite_file, tmp_path, monkeypatch):
    """As in a bare chroot: the batch ended at its summary, and workers gave no row."""
    read = Path.read_text

    def without_proc(path, *words, **more):
        if str(path).startswith("/proc"):
            raise FileNotFoundError(2, "No such file or directory", str(path))
        return read(path, *words, **more)

    monkeypatch.setattr(Path, "read_text", without_proc)
    found = batch.run_batch(load_suite(suite_file), tmp_path, solve=bench_workers.known)
    assert found.summary["complete"] and isinstance(found.summary["machine"]["cpu"], str) and resident_memory() > 1e7


def test_report_names_failures_first(suite_file, tmp_path):
    run_batch(load_suite(suite_file), tmp_path, solve=bench_workers.faulty)
    page = (tmp_path / "report.html").read_text()
    assert 0 < page.index("by nought") < page.index("Savings")
    assert "Machine" in page


@pytest.mark.slow
def test_a_dask_cluster_of_several_processes_gives_the_same(suite_file, tmp_path):
    distributed = pytest.importorskip("distributed")
    suite = load_suite(suite_file)
    here = run_batch(suite, tmp_path / "here", jobs=1, solve=bench_workers.faulty)
    before = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE), str(HERE.parent), before])
    try:
        with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as at:
            there = run_batch(suite, tmp_path / "there", scheduler=at.scheduler_address, solve=bench_workers.faulty)
    finally:
        os.environ["PYTHONPATH"] = before
    assert there.records == here.records
    assert len({r["worker"].get("process") for r in read_journal(tmp_path / "there" / NAME)[1]} - {None}) == 2


def test_the_main_module_is_the_users_while_workers_run():
    main = sys.modules["__main__"]
    with local(1) as place:
        future = place.executor.submit(os.getpid)
        assert sys.modules["__main__"] is main
        assert future.result() != os.getpid()
