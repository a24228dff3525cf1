"""Compiled node functions: right numbers, a cache that is private and verified, and children that run no local code."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from energy_opt.errors import BadInput
from energy_opt.motion import Move, Planner, Settings
from energy_opt.numerics import lanes, library
from energy_opt.numerics.batch import Batch
from energy_opt.numerics.compile import compiled
from energy_opt.numerics.library import compiler
from energy_opt.robot import load_robot

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")
ROOT = Path(library.__file__).parents[2]


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("ENERGY_OPT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture(scope="module")
def functions():
    x = ca.SX.sym("x", 2)
    return [ca.Function("twice", [x], [2 * x]), ca.Function("bent", [x], [ca.sin(x[0]) * x[1]])]


def works(built):
    answer = Batch(built[1], 1)(np.array([[0.5, 2.0]]))[0]
    return float(answer[0, 0]) == pytest.approx(2 * np.sin(0.5), rel=1e-15)


def libraries(cache):
    return list((cache / library.OWN).glob("*.so"))


def test_always_builds_once(cache, functions, monkeypatch):
    built, done = compiled(functions, "always")
    assert done and works(built) and cache.stat().st_mode & 0o077 == 0
    monkeypatch.setattr(library, "build", None)  # a second build would fail
    assert works(compiled(functions, "always")[0]) and len(libraries(cache)) == 1


def test_compiled_answers_are_those_of_the_virtual_machine(cache, model):
    robot = load_robot("ur5", lock={"wrist_1_joint": 0, "wrist_2_joint": 0, "wrist_3_joint": 0})  # soon built
    start = np.array([0.3, -1.2, 1.0])
    move = Move(start, start + 0.4, duration=1.2)
    answers = []
    for policy in ("always", "never"):
        settings = Settings(starts=2, controls=16, compile=policy)
        answers.append(Planner(robot, model, settings).solve(move))
    assert answers[0].solver.compiled and not answers[1].solver.compiled
    assert answers[0].energy.total == pytest.approx(answers[1].energy.total, rel=1e-6)


def test_another_processor_finds_nothing(cache, functions, monkeypatch):
    compiled(functions, "always")
    assert "flags" in library.cpu() or "Features" in library.cpu() or not Path("/proc/cpuinfo").exists()
    monkeypatch.setattr(library, "cpu", lambda: "another one")
    compiled(functions, "always")
    assert len(libraries(cache)) == 2


def test_a_bad_library_is_built_again(cache, functions):
    compiled(functions, "always")
    (first,) = libraries(cache)
    cut = first.read_bytes()[:1000]
    first.unlink()  # this process has loaded it
    first.write_bytes(cut)
    assert works(compiled(functions, "always")[0])
    (second,) = libraries(cache)
    elsewhere = cache.parent / "elsewhere.so"
    second.rename(elsewhere)
    second.symlink_to(elsewhere)
    assert works(compiled(functions, "always")[0])
    assert not libraries(cache)[0].is_symlink()
    libraries(cache)[0].chmod(0o777)
    assert works(compiled(functions, "always")[0])
    assert libraries(cache)[0].stat().st_mode & 0o022 == 0


@pytest.mark.parametrize("kind", ["open", "link", "foreign", "nowhere", "homeless", "full"])
def test_a_cache_that_is_not_private_or_not_there(cache, functions, monkeypatch, kind):
    cache.mkdir(mode=0o700)
    if kind == "open":
        cache.chmod(0o777)
    elif kind == "link":
        (cache.parent / "link").symlink_to(cache)
        monkeypatch.setenv("ENERGY_OPT_CACHE", str(cache.parent / "link"))
    elif kind == "foreign":
        monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    elif kind == "nowhere":
        (cache.parent / "file").touch()
        monkeypatch.setenv("ENERGY_OPT_CACHE", str(cache.parent / "file" / "cache"))
    elif kind == "homeless":
        for name in ("ENERGY_OPT_CACHE", "XDG_CACHE_HOME"):
            monkeypatch.delenv(name, raising=False)
        monkeypatch.setattr(Path, "home", classmethod(lambda cls: (_ for _ in ()).throw(RuntimeError("no home"))))
    elif kind == "full":

        def full(*args, **named):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(library.tempfile, "TemporaryDirectory", full)
    built, done = compiled(functions, "auto")
    assert not done and works(built)
    if kind not in ("full", "foreign"):
        library._own_folder.cache_clear()
        built, done = compiled(functions, "always")  # for this process alone
        assert done and works(built)
    assert not libraries(cache)


def test_a_cache_from_which_nothing_can_be_loaded(cache, functions, monkeypatch):
    """As on a file system without execution: it was called a fault of the program."""
    loading = ctypes.CDLL

    def refusing(path, *words, **more):
        if str(path).startswith(str(cache)):
            raise OSError("failed to map segment from shared object")
        return loading(path, *words, **more)

    compiled(functions, "always")
    monkeypatch.setattr(ctypes, "CDLL", refusing)
    lanes._library.cache_clear()
    library._own_folder.cache_clear()
    built, done = compiled(functions, "auto")
    assert not done and works(built)
    built, done = compiled(functions, "always")  # for this process alone
    assert done and works(built) and built[0].path.parent != cache / library.OWN
    monkeypatch.setattr(library, "_own_folder", lambda: cache)
    with pytest.raises(BadInput, match="compile always: the node functions cannot be loaded: failed to map"):
        compiled(functions, "always")


def test_auto_uses_what_is_in_the_cache_and_never_builds(cache, functions, monkeypatch):
    built, done = compiled(functions, "auto")
    assert not done and works(built) and not libraries(cache)
    compiled(functions, "always")
    monkeypatch.setattr(library, "build", None)
    built, done = compiled(functions, "auto")
    assert done and works(built)


def test_foreign_files_in_the_cache_folder_are_not_changed(cache, functions):
    """Also a folder that has the cache's own name, without its mark."""
    for name in ("build-release/kept.o", "source-main.c", "compiled/build-debug/kept.o", "compiled/source-x.c"):
        (cache / name).parent.mkdir(parents=True, exist_ok=True)
        (cache / name).write_text("kept")
        os.utime(cache / name, (0, 0))
        os.utime((cache / name).parent, (0, 0))
    before = sorted(cache.rglob("*"))
    assert compiled(functions, "auto")[1] is False and sorted(cache.rglob("*")) == before
    (cache / "compiled").rename(cache / "other")
    before = sorted(cache.rglob("*"))
    (cache / "compiled").mkdir(mode=0o700)
    (cache / "compiled" / library.TAG).touch(mode=0o600)
    (cache / "compiled" / "build-old").mkdir()
    os.utime(cache / "compiled" / "build-old", (0, 0))
    assert compiled(functions, "always")[1] is True
    assert set(before) < set(cache.rglob("*")) and not (cache / "compiled" / "build-old").exists()


def test_workers_run_no_local_code(tmp_path):
    (tmp_path / "selectors.py").write_text(f"open({str(tmp_path / 'sprung')!r}, 'w')")
    scripts = tmp_path / "scripts"
    scripts.mkdir()
    (scripts / "script.py").write_text(
        f"import os, sys\nsys.path.insert(0, {str(ROOT)!r})\nfrom energy_opt.batches.executors import local\n"
        "if __name__ == '__main__':\n    with local(1) as place:\n"
        "        print(place.executor.submit(os.getpid).result() != os.getpid())\n"
    )
    words = [sys.executable, str(scripts / "script.py")]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "True" and not (tmp_path / "sprung").exists()
