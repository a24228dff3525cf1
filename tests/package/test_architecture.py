"""The shape of the package: who may import whom."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import energy_opt

ROOT = Path(energy_opt.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))

# Packages of the two sides; they meet in the power model, in `next_motion` above both, and in the command line, which
# may import all.
MOTION = {"motion", "profiles", "formats", "tradeoffs", "batches", "jobs"}
DATA = {"measured", "static_poses", "diagnosis"}
ABOVE = {"next_motion", "virtual_arm"}


@cache
def nodes(module: Path) -> list[ast.AST]:
    """All of a file's syntax."""
    return list(ast.walk(ast.parse(module.read_text(encoding="utf-8"))))


def imports(module: Path) -> Iterator[str]:
    """Every module that a file imports, inside functions too, as absolute dotted names."""
    for node in nodes(module):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def part(module: Path) -> str:
    """The package (or top-level module) of energy_opt that a file belongs to."""
    return module.relative_to(ROOT).parts[0].removesuffix(".py")


def parts_imported(module: Path) -> set[str]:
    """The parts of energy_opt that a file imports."""
    names = [name.split(".") for name in imports(module)]
    return {name[1] for name in names if name[0] == "energy_opt" and len(name) > 1} - {part(module), "__version__"}


@pytest.mark.parametrize(
    ("library", "place"),
    [
        ("pinocchio", "robot/rigid_body.py"),
        ("coal", "cell/solids.py"),
        ("toppra", "motion/timing/toppra.py"),
        ("highspy", "schedule/milp.py"),
        ("matplotlib", "reports/plots.py"),
        ("mujoco", "virtual_arm/mujoco_arm.py"),
        ("rosbags", "formats/bags.py"),
        ("ompl", "motion/initial_paths/ompl.py"),
        ("trimesh", "cell/scene_files/parts.py"),
        ("yaml", "files.py"),
        ("tomllib", "files.py"),
    ],
)
def test_one_module_knows_each_library(library: str, place: str) -> None:
    users = {m.relative_to(ROOT).as_posix() for m in MODULES if any(x.split(".")[0] == library for x in imports(m))}
    assert users == {place}


def test_data_and_motion_meet_only_in_the_power_model_and_above_both() -> None:
    for module in MODULES:
        if part(module) in MOTION:
            assert not parts_imported(module) & (DATA | ABOVE), module
        if part(module) in DATA:
            assert not parts_imported(module) & (MOTION | ABOVE), module


def test_the_virtual_arm_takes_no_part_of_our_inverse_dynamics() -> None:
    for module in MODULES:
        if part(module) == "virtual_arm":
            assert not parts_imported(module) & {"dynamics", "measured", "static_poses", "diagnosis"}, module


def test_dependencies_point_one_way() -> None:
    """The parts form a graph without cycles; the command line is on top and errors at the bottom."""
    graph: dict[str, set[str]] = {}
    for module in MODULES:
        graph.setdefault(part(module), set()).update(parts_imported(module))
    assert (
        graph["errors"] == set() and graph["files"] <= {"errors"} and graph["effects"] <= {"errors", "files", "names"}
    )
    assert {name for name, used in graph.items() if "cli" in used} <= {"__main__"}
    while graph:
        free = [name for name, used in graph.items() if not used & set(graph)]
        assert free, f"a cycle among {sorted(graph)}"
        for name in free:
            del graph[name]


def test_the_page_on_architecture_has_the_rooms_in_an_order_in_which_they_import() -> None:
    page = (Path(__file__).parents[2] / "docs" / "architecture.md").read_text(encoding="utf-8")
    order = [name for row in re.findall(r"^\| (`.*?) \|", page, re.M) for name in re.findall(r"`(\w+)`", row)]
    parts = {part(module) for module in MODULES if not part(module).startswith("__")}
    assert sorted(order) == sorted(parts)
    for module in MODULES:
        if part(module) in parts:
            assert parts_imported(module) <= set(order[: order.index(part(module))]), module


def dotted(module: Path) -> str:
    """A file's name as it is imported."""
    return ".".join(("energy_opt", *module.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__")


def without_what_leads_nowhere(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """A graph less all nodes from which no circle can be reached."""
    while free := [name for name, used in graph.items() if not used & set(graph)]:
        for name in free:
            del graph[name]
    return graph


def test_modules_form_no_circles() -> None:
    """Inside packages either; imports for types alone, and inside functions, count."""
    names = {dotted(module): module for module in MODULES}
    graph = {name: {x for x in imports(module) if x in names} - {name, "energy_opt"} for name, module in names.items()}
    for name, used in graph.items():  # `from package import module` is no use of the package's own names
        for package in [x for x in used if any(other.startswith(x + ".") for other in used)]:
            if name.startswith(package + "."):
                used.discard(package)
    assert not without_what_leads_nowhere(graph)


# Of motion and of diagnosis; each may use what is named after it.
ROOMS = ("plan", "initial_paths", "retime", "reshape", "timing", "judge", "limits")
STAGES = ("report", "verdict", "search", "evidence", "fit", "joint_side", "hypothesis", "data")


def used_rooms(package: str, rooms: tuple[str, ...]) -> dict[str, set[str]]:
    """The other rooms of a package that each of its rooms imports from."""
    used: dict[str, set[str]] = {room: set() for room in rooms}
    for module in MODULES:
        place = module.relative_to(ROOT).with_suffix("").parts
        if place[0] == package and place[1] in rooms:
            names = {x.split(".")[2] for x in imports(module) if x.startswith(f"energy_opt.{package}.")}
            used[place[1]] |= names & set(rooms) - {place[1]}
    return used


@pytest.mark.parametrize(("package", "rooms"), [("motion", ROOMS), ("diagnosis", STAGES)])
def test_rooms_point_one_way(package: str, rooms: tuple[str, ...]) -> None:
    used = used_rooms(package, rooms)
    for k, room in enumerate(rooms):
        assert used[room] <= set(rooms[k + 1 :]), room


def test_what_all_rooms_of_motion_use_uses_none_of_them() -> None:
    for module in MODULES:
        place = module.relative_to(ROOT).parts
        if place[0] == "motion" and len(place) == 2 and place[1] not in ("__init__.py", "result.py"):
            used = {x.split(".")[2] for x in imports(module) if x.startswith("energy_opt.motion.")}
            assert not used & set(ROOMS), f"{module}: what all rooms use uses one of them"
    used = used_rooms("motion", ROOMS)
    assert not used["limits"] and not used["retime"] & {"reshape"}


def privates(module: Path) -> tuple[set[str], dict[str, int]]:
    """Private names that a module makes, and those that it takes of something else, with the line."""
    made = {node.name for node in nodes(module) if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    taken: dict[str, int] = {}
    for node in nodes(module):
        if isinstance(node, ast.Attribute):
            if isinstance(node.ctx, ast.Store):
                made.add(node.attr)
            elif not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")):
                taken[node.attr] = node.lineno
        elif isinstance(node, (ast.AnnAssign, ast.Assign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            made |= {target.id for target in targets if isinstance(target, ast.Name)}
        elif isinstance(node, ast.ImportFrom):
            taken |= {alias.name: node.lineno for alias in node.names}

    def hidden(name: str) -> bool:
        return name.startswith("_") and not name.startswith("__")

    return {name for name in made if hidden(name)}, {name: line for name, line in taken.items() if hidden(name)}


def test_no_module_uses_private_names_of_another() -> None:
    found = {module: privates(module) for module in MODULES}
    ours = set().union(*(made for made, _ in found.values()))
    touched = [
        f"{module.relative_to(ROOT)}:{line}: {name}"
        for module, (made, taken) in found.items()
        for name, line in taken.items()
        if name in ours - made
    ]
    assert not touched, "\n".join(touched)


def test_modules_stay_small() -> None:
    long = {str(m): n for m in MODULES if (n := len(m.read_text(encoding="utf-8").splitlines())) > 350}
    assert not long


HEAVY = ("casadi", "pinocchio", "coal", "toppra", "matplotlib", "scipy", "pyarrow", "dask", "distributed", "mujoco")
PLANS = [f"energy_opt.front.{name}" for name in ("check", "diagnose", "evaluate", "job", "tradeoff")]


@pytest.mark.parametrize(
    ("modules", "heavy"),
    [
        (["energy_opt.cli.main"], HEAVY),
        (["energy_opt.front.controllers"], HEAVY),
        (PLANS, ("toppra", "matplotlib", "pyarrow", "dask", "distributed", "mujoco", "energy_opt.placement")),
    ],
)
def test_modules_start_without_heavy_libraries(modules: list[str], heavy: tuple[str, ...]) -> None:
    code = f"import sys, {', '.join(modules)}; print([m for m in {heavy!r} if m in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", code], cwd=ROOT.parent, capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"
