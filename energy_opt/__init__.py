"""Joint moves of robot arms to minimum energy, and power models calibrated from measured data.

Where to look: `effects` (what uses energy, one class each), `power` (the model that joins them), `robot` and `dynamics`
(the arm), `motion` (optimization of one move), `tradeoff` and `bench` (many of them), `measured` and `diagnose` (logged
data), `virtual_arm` (data without hardware), `cli` (the command line).
"""

__version__ = "0.1.0"
