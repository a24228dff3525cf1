"""Power, energy and limits of a motion by a second way: it reads the URDF itself and shares no code with the package.

Recursive Newton-Euler in the world's frame, all instants at once; quintics between rows by solving for their
coefficients. Slow and plain on purpose.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np

G = np.array([0.0, 0.0, 9.81])
Link = tuple[float, np.ndarray, np.ndarray]  # mass, centre of mass, inertia there in the link's frame


def _numbers(element: ET.Element | None, name: str, default: str) -> np.ndarray:
    return np.array([float(x) for x in (default if element is None else element.get(name, default)).split()])


def _rpy(angles: np.ndarray) -> np.ndarray:
    (a, b, c), (x, y, z) = np.cos(angles), np.sin(angles)
    roll = np.array([[1, 0, 0], [0, a, -x], [0, x, a]])
    pitch = np.array([[b, 0, y], [0, 1, 0], [-y, 0, b]])
    yaw = np.array([[c, -z, 0], [z, c, 0], [0, 0, 1]])
    return yaw @ pitch @ roll


def _turn(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotations (M, 3, 3) about a unit axis by angles (M,)."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * k + (1 - c) * (k @ k)


def _apply(r: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.einsum("mij,...j->mi" if x.ndim == 1 else "mij,mj->mi", r, x)


class Arm:
    """A tree of links from URDF text."""

    def __init__(self, text: str, joints: Sequence[str], held: Mapping[str, float] | None = None) -> None:
        root = ET.fromstring(text)
        self.joints, self.held = list(joints), dict(held or {})
        self.links: dict[str, Link] = {}
        for link in root.findall("link"):
            body = link.find("inertial")
            if body is None:
                continue
            origin, inertia = body.find("origin"), body.find("inertia")
            r = _rpy(_numbers(origin, "rpy", "0 0 0"))
            xx, xy, xz, yy, yz, zz = (
                float("0" if inertia is None else inertia.get(n, "0"))
                for n in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            )
            tensor = r @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ r.T
            mass = body.find("mass")
            assert mass is not None
            self.links[link.get("name", "")] = float(mass.get("value", "0")), _numbers(origin, "xyz", "0 0 0"), tensor
        self.children: dict[str, list[ET.Element]] = {}
        below = set()
        for joint in root.findall("joint"):
            parent, child = joint.find("parent"), joint.find("child")
            assert parent is not None and child is not None
            self.children.setdefault(parent.get("link", ""), []).append(joint)
            below.add(child.get("link"))
        (self.root,) = {link.get("name", "") for link in root.findall("link")} - below
        self.extra: dict[str, list[Link]] = {}

    def carry(self, mass: float, com: np.ndarray) -> None:
        """A point mass in the frame of the last joint."""
        for joints in self.children.values():
            for joint in joints:
                if joint.get("name") == self.joints[-1]:
                    child = joint.find("child")
                    assert child is not None
                    self.extra.setdefault(child.get("link", ""), []).append((mass, np.asarray(com), np.zeros((3, 3))))

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Joint torques (M, n) [N m] or forces [N]."""
        m = len(q)
        zero = np.zeros((m, 3))
        places: dict[int, tuple[np.ndarray, np.ndarray, bool]] = {}
        wrenches: list[tuple[tuple[int, ...], np.ndarray, np.ndarray, np.ndarray]] = []
        todo = [(self.root, (), np.broadcast_to(np.eye(3), (m, 3, 3)), zero, zero, zero, zero + G)]
        while todo:
            name, chain, r, p, w, dw, acc = todo.pop()
            for mass, com, inertia in [*([self.links[name]] if name in self.links else []), *self.extra.get(name, [])]:
                c = _apply(r, com)
                force = mass * (acc + np.cross(dw, c) + np.cross(w, np.cross(w, c)))
                world = r @ inertia @ r.transpose(0, 2, 1)
                moment = _apply(world, dw) + np.cross(w, _apply(world, w))
                wrenches.append((chain, p + c, force, moment))
            for joint in self.children.get(name, []):
                origin, child = joint.find("origin"), joint.find("child")
                assert child is not None
                lever = _apply(r, _numbers(origin, "xyz", "0 0 0"))
                frame = r @ _rpy(_numbers(origin, "rpy", "0 0 0"))
                at, its = p + lever, acc + np.cross(dw, lever) + np.cross(w, np.cross(w, lever))
                label, kind = joint.get("name", ""), joint.get("type")
                axis = _numbers(joint.find("axis"), "xyz", "1 0 0")
                axis = axis / (np.linalg.norm(axis) or 1.0)
                to, w1, dw1 = chain, w, dw
                if kind != "fixed":
                    value, speed, gain = np.full(m, self.held.get(label, 0.0)), np.zeros(m), np.zeros(m)
                    z = _apply(frame, axis)
                    if label in self.joints:
                        k = self.joints.index(label)
                        value, speed, gain = q[:, k], v[:, k], a[:, k]
                        places[k], to = (at, z, kind == "prismatic"), (*chain, k)
                    if kind == "prismatic":
                        slide = z * value[:, None]
                        its = its + np.cross(dw, slide) + np.cross(w, np.cross(w, slide))
                        its = its + 2 * np.cross(w, z * speed[:, None]) + z * gain[:, None]
                        at = at + slide
                    else:
                        frame = frame @ _turn(axis, value)
                        w1 = w + z * speed[:, None]
                        dw1 = dw + z * gain[:, None] + np.cross(w, z * speed[:, None])
                todo.append((child.get("link", ""), to, frame, at, w1, dw1, its))
        out = np.zeros((m, len(self.joints)))
        for chain, point, force, moment in wrenches:
            for k in chain:
                at, z, slides = places[k]
                load = force if slides else moment + np.cross(point - at, force)
                out[:, k] += np.sum(z * load, axis=1)
        return out


def curve(
    t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, places: int = 8
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Times (N - 1, places) and derivatives 0 ... 3 (N - 1, places, n) of the quintics between rows, ends included."""
    h = np.diff(t)[:, None]
    powers = np.arange(6)
    ends = []
    for x in (0.0, 1.0):
        for order in range(3):
            factor = np.array([np.prod([k - i for i in range(order)]) for k in powers])
            ends.append(factor * np.where(powers >= order, x ** np.maximum(powers - order, 0.0), 0.0))
    data = np.stack(
        [0 * q[:-1], v[:-1] * h, a[:-1] * h**2, q[1:] - q[:-1], v[1:] * h, a[1:] * h**2]
    )  # relative to the first row
    c = np.einsum("ij,jmn->imn", np.linalg.inv(np.array(ends)), data)
    x = np.linspace(0, 1, places)
    out = []
    for order in range(4):
        factor = np.array([np.prod([k - i for i in range(order)]) for k in powers])
        shape = factor * np.where(powers >= order, x[:, None] ** np.maximum(powers - order, 0), 0.0)
        value = np.einsum("pi,imn->mpn", shape, c) / h[:, :, None] ** order
        out.append(value + q[:-1, None] if order == 0 else value)
    return t[:-1, None] + h * x, out


def judged(
    arm: Arm, bounds: Mapping[str, np.ndarray], standby: float, copper: np.ndarray, rows: Sequence[np.ndarray]
) -> tuple[float, float]:
    """Energy [J] under overhead and copper loss, and the largest excess over a limit as a share of the bound."""
    t, q, v, a = rows
    _, (x, dx, ddx, jerk) = curve(t, q, v, a)
    tau = arm.torque(*(y.reshape(-1, q.shape[1]) for y in (x, dx, ddx))).reshape(x.shape)
    power = standby + np.sum(tau * dx + copper * tau**2, axis=2)
    nodes = np.linspace(0, 1, power.shape[1])
    weight = np.linalg.solve(np.vander(nodes, increasing=True).T, 1 / (np.arange(len(nodes)) + 1))  # of polynomials
    energy = float(np.sum((power @ weight) * np.diff(t)))
    excess = [
        np.max(np.abs(value) / bounds[name]) - 1
        for name, value in (("velocity", dx), ("acceleration", ddx), ("jerk", jerk), ("effort", tau))
    ]
    span = np.where(np.isfinite(bounds["upper"] - bounds["lower"]), bounds["upper"] - bounds["lower"], 1.0)
    excess += [np.max((bounds["lower"] - x) / span), np.max((x - bounds["upper"]) / span)]
    return energy, float(max(excess))
