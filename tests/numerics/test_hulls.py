"""Distances of convex hulls on links against the library coal, and half-spaces against the formula."""

from concurrent.futures import ThreadPoolExecutor

import coal
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from energy_opt.numerics import native
from energy_opt.numerics.hulls import Hulls

RNG = np.random.default_rng(7)
SIZES = (4, 8, 8, 20, 60, 150)  # vertices, one set a link
RADIUS = np.array([0.0, 0.0, 0.05, 0.0, 0.0, 0.02])
POSES = 40
A, B = np.triu_indices(len(SIZES), 1)


def hull(points: np.ndarray) -> coal.ConvexBase:
    cloud = coal.StdVec_Vec3s()
    for point in points:
        cloud.append(point)
    return coal.Convex.convexHull(cloud, True, "Qt")


@pytest.fixture(scope="module")
def case():
    """Hulls of random points, frames of their links, and coal's distances and normals."""
    sets = [RNG.normal(size=(size, 3)) * RNG.uniform(0.1, 0.3, 3) for size in SIZES]
    rotation = Rotation.random(POSES * len(SIZES), random_state=1).as_matrix().reshape(POSES, -1, 3, 3)
    origin = RNG.normal(size=(POSES, len(SIZES), 3)) * 0.45
    shapes, distance = [hull(points) for points in sets], np.empty((POSES, len(A)))
    for k in range(POSES):
        placed = [coal.Transform3s(rotation[k, i], origin[k, i]) for i in range(len(SIZES))]
        for p, (i, j) in enumerate(zip(A, B, strict=True)):
            result = coal.DistanceResult()
            found = coal.distance(shapes[i], placed[i], shapes[j], placed[j], coal.DistanceRequest(), result)
            distance[k, p] = found - RADIUS[i] - RADIUS[j]
    assert (distance < -0.1).any() and ((distance > 0) & (distance < 0.1)).any() and (distance > 0.5).any()
    return sets, rotation, origin, distance


def hulls(sets: list[np.ndarray]) -> Hulls:
    return Hulls(sets, RADIUS, np.arange(len(sets)), np.zeros((len(sets), 3)))


@pytest.mark.skipif(native.library("hulls") is None, reason="no C compiler")
@pytest.mark.parametrize("begin", ["nowhere", "anywhere", "found"])
def test_distances_and_depths_are_those_of_coal(case, begin: str) -> None:
    sets, rotation, origin, expected = case
    normal = np.zeros((POSES, len(A), 3))
    if begin == "anywhere":
        normal = RNG.normal(size=normal.shape)
        normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    for _ in range(2 if begin == "found" else 1):
        found = hulls(sets).apart(rotation, origin, A, B, 10.0, normal)
    assert found == pytest.approx(expected, abs=2e-6)
    for k, p in np.ndindex(found.shape):  # the height along the normal is the distance
        i, j, n = A[p], B[p], normal[k, p]
        low = (sets[i] @ rotation[k, i].T @ n).min() + n @ (origin[k, i] - origin[k, j])
        low -= (sets[j] @ rotation[k, j].T @ n).max() + RADIUS[i] + RADIUS[j]
        assert low == pytest.approx(found[k, p], abs=1e-9)


@pytest.mark.parametrize("compiled", [True, False])
def test_distances_beyond_the_reach_are_lower_bounds(case, compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    sets, rotation, origin, expected = case
    if not compiled:
        monkeypatch.setattr(native, "library", lambda part: None)
    elif native.library("hulls") is None:
        pytest.skip("no C compiler")
    reach = 0.2
    found = hulls(sets).apart(rotation, origin, A, B, reach, np.zeros((POSES, len(A), 3)))
    far = found >= reach
    assert far.any() and (found[far] <= expected[far] + 1e-9).all()
    assert (expected[~far] < reach).all() if compiled else np.isnan(found[~far]).all()


@pytest.mark.parametrize("compiled", [True, False])
def test_a_half_space_is_measured_to_its_plane(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not compiled:
        monkeypatch.setattr(native, "library", lambda part: None)
    elif native.library("hulls") is None:
        pytest.skip("no C compiler")
    points = RNG.normal(size=(30, 3))
    through, face = np.array([0.1, -0.2, 0.3]), np.array([0.0, 0.6, 0.8])
    rotation, origin = Rotation.random(2, random_state=3).as_matrix()[None], RNG.normal(size=(1, 2, 3))
    both = Hulls([points, through[None]], np.zeros(2), np.arange(2), np.stack([np.zeros(3), face]))
    ahead, back = both.apart(rotation, origin, np.array([0, 1]), np.array([1, 0]), -10.0, np.zeros((1, 2, 3)))[0]
    n = rotation[0, 1] @ face
    height = ((points @ rotation[0, 0].T + origin[0, 0] - rotation[0, 1] @ through - origin[0, 1]) @ n).min()
    assert ahead == pytest.approx(height) if compiled else ahead <= max(height, 0.0)
    assert np.isnan(back)


def test_threads_share_the_hulls_of_a_cell(case) -> None:
    sets, rotation, origin, _ = case
    both = hulls(sets)
    many = [(np.tile(rotation[s::4], (20, 1, 1, 1)), np.tile(origin[s::4], (20, 1, 1))) for s in range(4)]

    def distances(frames: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        return both.apart(*frames, A, B, 10.0, np.zeros((len(frames[0]), len(A), 3)))

    alone = [distances(frames) for frames in many]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(5):
            for found, expected in zip(pool.map(distances, many), alone, strict=True):
                assert found == pytest.approx(expected, abs=1e-6, nan_ok=True)
