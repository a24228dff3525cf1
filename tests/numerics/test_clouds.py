"""Lowest points of many sets, far apart or not: in C and in NumPy, against plain loops."""

import numpy as np
import pytest

from energy_opt.numerics import native
from energy_opt.numerics.hulls import Clouds

RNG = np.random.default_rng(4)
SETS = [RNG.normal(size=(size, 3)) for size in (1, 2, 17, 60)]
WHICH, DIRECTION = RNG.integers(0, len(SETS), 40), RNG.normal(size=(40, 3))
MANY = RNG.random(40) < 0.7
MOST, ABOVE, BESIDE = 3, 1.0, 0.5


def spread(points: np.ndarray, direction: np.ndarray, many: bool) -> list[int]:
    height = points @ direction
    out = [int(np.argmin(height))]
    usable = np.flatnonzero(height <= height.min() + ABOVE)
    while many and len(out) < MOST:
        gap = np.linalg.norm(points[usable, None] - points[out], axis=2).min(axis=1)
        if gap.max() <= BESIDE:
            break
        out.append(int(usable[np.argmax(gap)]))
    return out + [-1] * (MOST - len(out))


@pytest.mark.parametrize("compiled", [True, False])
def test_lowest_and_low_points(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not compiled:
        monkeypatch.setattr(native, "library", lambda part: None)
    elif native.library("hulls") is None:
        pytest.skip("no C compiler")
    found = Clouds(SETS)
    vertex, height = found.lowest(WHICH, DIRECTION)
    expected = [spread(SETS[k], d, m) for k, d, m in zip(WHICH, DIRECTION, MANY, strict=True)]
    assert max(len([v for v in row if v >= 0]) for row in expected) == MOST
    assert vertex.tolist() == [row[0] for row in expected]
    assert height == pytest.approx([(SETS[k] @ d).min() for k, d in zip(WHICH, DIRECTION, strict=True)])
    assert found.spread(WHICH, DIRECTION, MANY, MOST, ABOVE, BESIDE).tolist() == expected
    assert found.points(WHICH, vertex) == pytest.approx(
        np.array([SETS[k][v] for k, v in zip(WHICH, vertex, strict=True)])
    )
