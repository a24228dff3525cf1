"""What several tests start from: robots and the source paper's model, built once."""

import os
import signal

os.environ["OMP_NUM_THREADS"] = "1"  # tests run side by side: one thread each, said before numpy is loaded
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import pytest

# a shell lets what it starts in the background ignore Ctrl-C, and programs inherit that; tests of Ctrl-C need it
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

from energy_opt.power import PowerModel, source_method_2
from energy_opt.robot import Robot, load_robot


@pytest.fixture(scope="session")
def panda() -> Robot:
    return load_robot("panda")


@pytest.fixture(scope="session")
def ur5() -> Robot:
    return load_robot("ur5")


@pytest.fixture(scope="session")
def model() -> PowerModel:
    return source_method_2()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """What runs for a night is left out unless asked for by `-m nightly`; what is slow, unless by `-m` or in CI."""
    asked = config.option.markexpr
    left_out = set() if "nightly" in asked else {"nightly"}
    if not asked and not os.environ.get("CI"):
        left_out.add("slow")
    late = [item for item in items if any(item.get_closest_marker(name) for name in left_out)]
    items[:] = [item for item in items if item not in late]
    config.hook.pytest_deselected(items=late)
