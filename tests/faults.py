"""Faults of files, as their readers state them."""

from collections.abc import Callable
from typing import Any

from energy_opt.errors import BadInput


def faults_of(read: Callable[..., Any], *given: Any, **named: Any) -> list[str]:
    """The lines of the error that a reader raises; none if the file is usable."""
    try:
        read(*given, **named)
    except BadInput as error:
        return str(error).splitlines()
    return []
