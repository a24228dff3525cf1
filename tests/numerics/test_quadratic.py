"""Banded quadratic programs, judged by the conditions of an optimum on dense matrices."""

import os
import subprocess
import sys
from pathlib import Path

import cvxpy
import numpy as np
import pytest

import energy_opt
from energy_opt.numerics import native
from energy_opt.numerics.library import compiler
from energy_opt.numerics.quadratic import Banded, Constraints, add_nodes, add_places, minimise

COMPILED = pytest.mark.skipif(compiler() is None, reason="no C compiler")
PRICE = 20.0
JOINTS, POINTS, WINDOW = 2, 15, 6
SIZE, WIDTH = JOINTS * POINTS, JOINTS * WINDOW


def banded(matrix: np.ndarray) -> np.ndarray:
    out = np.zeros((len(matrix), WIDTH))
    for offset in range(WIDTH):
        out[: len(matrix) - offset, offset] = np.diagonal(matrix, -offset)
    return out


def problem(seed: int, border: int, convex: bool = True) -> tuple[np.ndarray, np.ndarray, Constraints, np.ndarray]:
    """A dense Hessian with a band and a border, a gradient, constraints of all kinds, and their dense matrix."""
    rng = np.random.default_rng(seed)
    full = np.zeros((SIZE + border, SIZE + border))
    for k in range(0, SIZE - WIDTH + 1, JOINTS):
        block = rng.normal(size=(WIDTH, WIDTH)) / 2
        full[k : k + WIDTH, k : k + WIDTH] += block @ block.T
    full[SIZE:, :SIZE] = 0.1 * rng.normal(size=(border, SIZE))
    full[:SIZE, SIZE:] = full[SIZE:, :SIZE].T
    full[SIZE:, SIZE:] = 5 * np.eye(border)
    if not convex:
        full[:SIZE, :SIZE] -= 6 * np.eye(SIZE)
    first, joint, one = rng.integers(-3, POINTS - 2, 9), rng.integers(0, JOINTS, 9), rng.normal(size=(9, WINDOW))
    wide_first, wide = rng.integers(-3, POINTS - 2, 8), rng.normal(size=(8, WIDTH))
    place_first, basis = rng.integers(-3, POINTS - 2, 4), rng.uniform(0, 1, (4, WINDOW))
    place, gradient = rng.integers(0, 4, 8), rng.normal(size=(8, JOINTS))
    windows = [(f, np.outer(c, np.arange(JOINTS) == j).ravel()) for f, j, c in zip(first, joint, one, strict=True)]
    windows += list(zip(wide_first, wide, strict=True))
    windows += [(place_first[p], np.outer(basis[p], g).ravel()) for p, g in zip(place, gradient, strict=True)]
    dense = np.zeros((25, SIZE + border))
    for row, (begin, values) in zip(dense, windows, strict=True):
        for k, value in enumerate(values):
            if 0 <= begin * JOINTS + k < SIZE:  # what is pinned is left out
                row[begin * JOINTS + k] = value
    dense[:, SIZE:] = rng.normal(size=(25, border))
    room = rng.uniform(0.05, 0.5, size=25)
    held = Constraints.of(
        JOINTS, border, first=first, joint=joint, coefficient=one, wide_first=wide_first, wide=wide, place=place,
        gradient=gradient, place_first=place_first, basis=basis, border=dense[:, SIZE:],
        floor=np.where(np.arange(25) % 3 == 0, -np.inf, -room), ceiling=room, keys=np.arange(25),
    )  # fmt: skip
    return full, rng.normal(size=SIZE + border) * 5, held, dense


@pytest.mark.parametrize(("seed", "border"), [(0, 0), (1, 0), (2, 1), (3, 3)])
def test_the_conditions_of_an_optimum_hold(seed: int, border: int) -> None:
    full, g, held, matrix = problem(seed, border)
    h = Banded(banded(full[:SIZE, :SIZE]), full[:SIZE, SIZE:].copy(), full[SIZE:, SIZE:].copy())
    mass = Banded(banded(np.eye(SIZE)), np.zeros((SIZE, border)), np.eye(border))
    low, high = np.full(len(g), -1.0), np.full(len(g), 0.7)
    found = minimise(h, g, (low, high), held, PRICE, mass)
    assert found.damping == 0 and found.steps < 40
    d, lam = found.d, found.multipliers
    value, slope = matrix @ d, full @ d + g + matrix.T @ lam
    assert held.times(d) == pytest.approx(value)
    assert found.saved == pytest.approx(-(g @ d + d @ full @ d / 2))
    assert np.all(d >= low) and np.all(d <= high)
    inside = (d > low + 1e-3) & (d < high - 1e-3)
    assert np.abs(slope[inside]).max() < 2e-3
    assert slope[d < low + 1e-6].min(initial=0) > -2e-3 and slope[d > high - 1e-6].max(initial=0) < 2e-3
    assert np.abs(lam).max() <= PRICE
    over = np.maximum(np.maximum(value - held.ceiling, held.floor - value), 0)
    assert found.broken == pytest.approx(over.sum(), abs=1e-4)
    idle = (value < held.ceiling - 1e-2) & (value > held.floor + 1e-2)
    assert np.abs(lam[idle]).max(initial=0) < 1e-3
    assert np.all(np.abs(lam[over > 1e-3]) > PRICE - 1e-2)


def test_constraints_that_cannot_be_kept_are_broken_by_as_little_as_pays() -> None:
    h = Banded(np.ones((2, 1)), np.zeros((2, 0)), np.zeros((0, 0)))
    one = np.eye(1, 6)[[0, 0]]  # x >= 2 and x <= 1
    held = Constraints.of(
        1, 0, wide_first=np.zeros(2), wide=one, floor=np.array([2.0, -np.inf]), ceiling=np.array([np.inf, 1.0]),
        border=np.zeros((2, 0)), keys=np.arange(2),
    )  # fmt: skip
    found = minimise(h, np.zeros(2), (np.full(2, -5.0), np.full(2, 5.0)), held, PRICE, h)
    assert found.broken == pytest.approx(1.0, abs=1e-3) and found.d[0] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_program_far_from_any_free_point_ends_at_the_least_cost_with_excesses(
    compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        monkeypatch.setattr(native, "library", lambda part: None)
    rng = np.random.default_rng(4)
    count = 300  # floors up to 1 above what steps within the box of +-0.2 reach
    held = Constraints.of(
        JOINTS, 0, place=np.repeat(np.arange(10), 30), gradient=rng.normal(size=(count, JOINTS)),
        place_first=np.arange(10), basis=rng.uniform(0.1, 0.3, (10, WINDOW)), border=np.zeros((count, 0)),
        floor=rng.uniform(0.2, 1.0, count), ceiling=np.full(count, np.inf), keys=np.arange(count),
    )  # fmt: skip
    eye, none = Banded(banded(np.eye(SIZE)), np.zeros((SIZE, 0)), np.zeros((0, 0))), np.zeros((SIZE, 0))
    low, high = np.full(SIZE, -0.2), np.full(SIZE, 0.2)
    g = np.zeros(SIZE)
    mass = Banded(eye.band, none, np.zeros((0, 0)))
    found = minimise(eye, g, (low, high), held, PRICE, mass)
    soon = minimise(eye, g, (low, high), held, PRICE, mass, trying=True)
    assert soon.steps < found.steps and soon.broken > 1
    free = minimise(eye, g, (low, high), held.within(held.floor - 3, held.ceiling), PRICE, mass, trying=True)
    assert free.broken < 1e-3
    d = cvxpy.Variable(SIZE)
    excess = cvxpy.sum(cvxpy.pos(held.floor - held.sparse(SIZE).toarray() @ d))
    best = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(d) / 2 + PRICE * excess), [d >= low, d <= high])
    best.solve(solver="CLARABEL")
    over = np.maximum(held.floor - held.times(found.d), 0).sum()
    assert found.steps < 40
    assert found.broken == pytest.approx(over, rel=1e-3)
    assert found.d @ found.d / 2 + PRICE * over == pytest.approx(best.value, rel=1e-3)


def test_where_the_hessian_is_not_convex_enough_mass_is_added() -> None:
    full, g, held, _ = problem(4, 0, convex=False)
    assert np.linalg.eigvalsh(full).min() < 0
    h, mass = (Banded(banded(m), np.zeros((SIZE, 0)), np.zeros((0, 0))) for m in (full, np.eye(SIZE)))
    found = minimise(h, g, (np.full(SIZE, -0.1), np.full(SIZE, 0.1)), held, PRICE, mass)
    assert found.damping > 0
    saved = -(g @ found.d + found.d @ (full + found.damping * np.eye(SIZE)) @ found.d / 2)
    assert found.saved == pytest.approx(saved) and saved > 0


def test_overflowing_numbers_are_reported_as_no_program() -> None:
    _, g, held, _ = problem(5, 0)
    h = Banded(np.full((SIZE, WIDTH), np.nan), np.zeros((SIZE, 0)), np.zeros((0, 0)))
    mass = Banded(banded(np.eye(SIZE)), np.zeros((SIZE, 0)), np.zeros((0, 0)))
    with pytest.raises(np.linalg.LinAlgError):
        minimise(h, g, (np.full(SIZE, -0.1), np.full(SIZE, 0.1)), held, PRICE, mass)


def test_joined_and_moved_constraints_are_the_same_matrix(tmp_path) -> None:
    _, _, a, first = problem(6, 1)
    _, _, b, second = problem(7, 1)
    d = np.random.default_rng(0).normal(size=SIZE + 1)
    both = a.joined(b)
    assert np.sort(both.times(d)) == pytest.approx(np.sort(np.concatenate([first @ d, second @ d])))
    named = dict(zip(both.keys.tolist(), range(both.count), strict=True))
    assert len(named) == 25 and both.moved(d).floor == pytest.approx(both.floor + both.times(d))


def of_one_kind(kind: str, first_key: int) -> Constraints:
    """Five constraints on one joint each ("one"), on all joints ("wide") or at places ("placed")."""
    rng = np.random.default_rng(first_key)
    given = {
        "one": {
            "first": rng.integers(0, 3, 5), "joint": rng.integers(0, JOINTS, 5),
            "coefficient": rng.normal(size=(5, WINDOW)),
        },
        "wide": {"wide_first": rng.integers(0, 3, 5), "wide": rng.normal(size=(5, WIDTH))},
        "placed": {
            "place": rng.integers(0, 2, 5), "gradient": rng.normal(size=(5, JOINTS)),
            "place_first": rng.integers(0, 3, 2), "basis": rng.uniform(0, 1, (2, WINDOW)),
        },
    }[kind]  # fmt: skip
    return Constraints.of(
        JOINTS, 1, **given, border=rng.normal(size=(5, 1)), floor=-rng.uniform(1, 2, 5), ceiling=rng.uniform(1, 2, 5),
        keys=first_key + np.arange(5),
    )  # fmt: skip


@pytest.mark.parametrize("first", ["one", "wide", "placed"])
@pytest.mark.parametrize("second", ["one", "wide", "placed"])
def test_each_constraint_keeps_its_line_and_bounds_when_others_join(first: str, second: str) -> None:
    parts = of_one_kind(first, 10), of_one_kind(second, 20)
    both = parts[0].joined(parts[1]).joined(of_one_kind("one", 30))
    assert sorted(both.keys.tolist()) == [*range(10, 15), *range(20, 25), *range(30, 35)]
    lines = both.sparse(SIZE).toarray()
    for part in (*parts, of_one_kind("one", 30)):
        for line, key, floor, ceiling in zip(
            part.sparse(SIZE).toarray(), part.keys, part.floor, part.ceiling, strict=True
        ):
            at = both.keys.tolist().index(key)
            assert lines[at] == pytest.approx(line) and (both.floor[at], both.ceiling[at]) == (floor, ceiling)


@COMPILED
@pytest.mark.parametrize(("seed", "border", "convex"), [(0, 0, True), (3, 3, True), (4, 2, False)])
def test_c_and_numpy_find_the_same(seed: int, border: int, convex: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    full, g, held, _ = problem(seed, border, convex)
    mass = Banded(banded(np.eye(SIZE)), np.zeros((SIZE, border)), np.eye(border))
    rng = np.random.default_rng(seed)
    blocks, local = rng.normal(size=(4, 3 * JOINTS + 1, 3 * JOINTS + 1)), rng.normal(size=(4, 3, WINDOW))
    blocks += blocks.transpose(0, 2, 1)
    first, d = np.array([-3, 0, 4, POINTS - 4]), rng.normal(size=SIZE + border)
    both = []
    for there in (True, False):
        if not there:
            monkeypatch.setattr(native, "library", lambda part: None)
        assert there == (native.library("quadratic") is not None)
        h = Banded(banded(full[:SIZE, :SIZE]), full[:SIZE, SIZE:].copy(), full[SIZE:, SIZE:].copy())
        found = minimise(h, g, (np.full(len(g), -1.0), np.full(len(g), 0.7)), held, PRICE, mass)
        add_nodes(h.band, blocks, local, first, JOINTS)
        add_places(h.band, blocks[:, :JOINTS, :JOINTS], local[:, 0], first, JOINTS)
        both.append((found.d, found.multipliers, found.broken, found.damping, found.saved, h.band, held.times(d)))
    for one, two in zip(*both, strict=True):
        assert one == pytest.approx(two, rel=1e-6, abs=1e-7)


@COMPILED
@pytest.mark.parametrize("joints", [6, 7, 8])
def test_rows_at_places_are_the_same_in_c_and_numpy_for_usual_arms(
    joints: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiled loops of six and seven joints are functions of their own."""
    rng, size = np.random.default_rng(joints), joints * POINTS
    g, d, place = rng.normal(size=size) * 5, rng.normal(size=size), rng.integers(0, 5, 20)
    held = Constraints.of(
        joints, 0, place=place, gradient=rng.normal(size=(20, joints)), basis=rng.uniform(0, 1, (5, WINDOW)),
        place_first=np.array([-3, 0, 4, 4, POINTS - 4]), border=np.zeros((20, 0)), floor=np.full(20, -0.2),
        ceiling=np.full(20, 0.1), keys=np.arange(20),
    )  # fmt: skip
    both = []
    for there in (True, False):
        if not there:
            monkeypatch.setattr(native, "library", lambda part: None)
        h, mass = (Banded(np.zeros((size, joints * WINDOW)), np.zeros((size, 0)), np.zeros((0, 0))) for _ in range(2))
        h.band[:, 0] = mass.band[:, 0] = 1.0
        found = minimise(h, g, (np.full(size, -1.0), np.full(size, 0.7)), held, PRICE, mass)
        both.append((found.d, found.multipliers, held.times(d)))
    for one, two in zip(*both, strict=True):
        assert one == pytest.approx(two, rel=1e-6, abs=1e-7)
    assert np.abs(both[0][1]).max() > 0.1


@pytest.mark.parametrize("cc", [pytest.param("", marks=COMPILED), "false"])
def test_machine_code_is_kept_in_the_cache_folder_and_nowhere_else(cc: str, tmp_path: Path) -> None:
    """Nothing is written beside the installed files, and a compiler that fails is done without."""
    code = "from energy_opt.numerics import native; native.begin()\n"
    code += "print(*(native.library(part) is not None for part in native.FILES))"
    env = {**os.environ, "ENERGY_OPT_CACHE": str(tmp_path / "cache"), "CC": cc}
    done = subprocess.run([sys.executable, "-c", code], check=True, env=env, capture_output=True, text=True)
    assert set(done.stdout.split()) == {str(cc != "false")}
    assert len(list((tmp_path / "cache" / "compiled").glob("*.so"))) == 3 * (cc != "false")
    package = os.path.dirname(energy_opt.__file__)
    assert not [name for _, _, names in os.walk(package) for name in names if name.endswith((".so", ".o"))]
