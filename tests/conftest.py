"""What several tests start from: robots and the source paper's model, built once."""

import pytest

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
    """What runs for a night is left out unless it is asked for by `-m nightly`."""
    if "nightly" not in config.option.markexpr:
        nightly = [item for item in items if item.get_closest_marker("nightly")]
        items[:] = [item for item in items if item not in nightly]
        config.hook.pytest_deselected(items=nightly)
