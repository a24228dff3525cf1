"""The source paper's nine measured moves (arXiv 2411.03194, Table 1): what its residual is, and what it cannot tell.

    python benchmarks/paper_table.py

Only energies and times are published. The residual of Method 1 is fitted by a constant energy per move and a power for
each direction, leaving one move out each time.
"""

from __future__ import annotations

import json
import sys
from itertools import chain

import numpy as np

OVERHEAD = 92.3  # [W] Method 1's overhead, as published
DIRECTIONS = ("horizontal", "diagonal", "vertical")
# Method 1, Method 2, measured [J], time [s], at velocity 1, 5 and 10.
TABLE = {
    "horizontal": ((794.96, 802.20, 814.13, 8.58), (395.88, 397.31, 408.98, 4.26), (299.89, 300.02, 311.98, 3.22)),
    "diagonal": ((902.74, 900.01, 935.92, 9.66), (455.88, 452.52, 476.54, 4.82), (341.33, 338.22, 358.10, 3.58)),
    "vertical": ((1024.09, 1012.82, 1049.08, 10.92), (527.26, 519.41, 543.99, 5.54), (377.62, 372.05, 392.23, 3.92)),
}


def rows() -> np.ndarray:
    """(9, 4): Method 1, Method 2, measured [J], time [s]."""
    return np.array(list(chain.from_iterable(TABLE[name] for name in DIRECTIONS)))


def design(time: np.ndarray, constant: bool = True) -> np.ndarray:
    """Columns of the residual's model: time in each direction, and one energy per move."""
    by_direction = np.kron(np.eye(3), np.ones((3, 1))) * time[:, None]
    return np.column_stack([np.ones(9), by_direction]) if constant else by_direction


def percent(error: np.ndarray, measured: np.ndarray) -> float:
    """Mean deviation, %."""
    return float(np.mean(np.abs(error) / measured) * 100)


def left_out(columns: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Error (9,) of every row under the fit to the other rows."""
    out = np.empty(len(residual))
    for k in range(len(residual)):
        rest = np.arange(len(residual)) != k
        x = np.linalg.lstsq(columns[rest], residual[rest], rcond=None)[0]
        out[k] = residual[k] - columns[k] @ x
    return out


def study() -> dict[str, object]:
    """All numbers of the report."""
    table = rows()
    measured, time = table[:, 2], table[:, 3]
    out: dict[str, object] = {}
    for k, name in enumerate(("method 1", "method 2")):
        residual = measured - table[:, k]
        columns = design(time)
        x = np.linalg.lstsq(columns, residual, rcond=None)[0]
        left = residual - columns @ x
        out[name] = {
            "error_before_percent": percent(residual, measured),
            "energy_per_move": float(x[0]),
            "power_by_direction": dict(zip(DIRECTIONS, map(float, x[1:]), strict=True)),
            "rms_after": float(np.sqrt(np.mean(left**2))),
            "error_after_percent": percent(left, measured),
            "error_left_out_percent": percent(left_out(columns, residual), measured),
            "left_out_without_energy_per_move": percent(left_out(design(time, constant=False), residual), measured),
            "left_out_with_one_power": percent(left_out(np.column_stack([np.ones(9), time]), residual), measured),
            "metering_time": float(x[0] / OVERHEAD),
        }
    return out


def main() -> None:
    """Print the study."""
    found = study()
    if "--json" in sys.argv[1:]:
        print(json.dumps(found, indent=2))
        return
    for name, values in found.items():
        assert isinstance(values, dict)
        powers = ", ".join(f"{x:.2f} W {direction}" for direction, x in values["power_by_direction"].items())
        print(f"{name}: mean deviation {values['error_before_percent']:.2f} %")
        print(f"  residual = {values['energy_per_move']:.2f} J per move + ({powers}) x time")
        print(f"  left after that: {values['rms_after']:.2f} J rms, {values['error_after_percent']:.3f} %")
        print(
            f"  leaving one move out: {values['error_left_out_percent']:.3f} %; "
            f"{values['left_out_without_energy_per_move']:.3f} % without the energy per move, "
            f"{values['left_out_with_one_power']:.3f} % with one power for all directions"
        )
        print(
            "  ambiguous: an energy per move, whatever its speed, is dry friction over the path's length, or "
            f"{values['metering_time']:.3f} s of metering beyond the move at {OVERHEAD} W; the rows cannot tell"
        )


if __name__ == "__main__":
    main()
