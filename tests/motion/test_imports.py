"""What the first timing imports, and what it leaves to others."""

from __future__ import annotations

import subprocess
import sys

USE = """
import sys
import numpy as np
import energy_opt as eo
goal = [0.3, 0.2, 0.1, -1.2, 0.1, 1.1, 0.1]
eo.optimize("panda", start=[0, 0, 0, -1, 0, 1, 0], goal=goal, mode="retime", model="source-method-2", compile="never")
assert "toppra" in sys.modules and "matplotlib.pyplot" not in sys.modules, sorted(sys.modules)
import toppra.algorithm.algorithm as own
assert own.plt.figure().axes == []  # its inspection plots import matplotlib
import matplotlib.pyplot
assert matplotlib.pyplot.figure is own.plt.figure and matplotlib.__version__
"""


def test_toppra_without_matplotlib_and_its_plots_with_it() -> None:
    subprocess.run([sys.executable, "-c", USE], check=True, timeout=60)
