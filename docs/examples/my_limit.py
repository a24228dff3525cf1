"""A limit of your own: the mechanical power of each joint's drive stays at or below 25 W.

From Python, `python my_limit.py`; from the command line `energy-opt optimize --conditions my_limit.py ...`.
"""

import casadi as ca

import energy_opt as eo


class DrivePower(eo.conditions.Limit):
    """|tau_m v| <= bound in every joint, with the motors' torque tau_m [N m] and the joint's velocity v [rad/s]."""

    name = "drive_power"
    unit = "W"
    binds = "joint"  # a value of each joint; "arm" for one number
    bound = 25.0  # [W]

    def value(self, x: eo.conditions.State) -> ca.SX:
        """The limited value (n, 1) at a state with q, v, a, effort (n, 1), power and t (1, 1)."""
        return x.effort * x.v


if __name__ == "__main__":
    result = eo.optimize(
        "panda",
        start=[0, -0.785, 0, -2.356, 0, 1.571, 0.785],
        goal=[1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4],
        duration=2.5,
        conditions=[eo.conditions.ToolSpeed(1.2), DrivePower()],
        starts=1,
        controls=16,
    )
    print(result)
    used = result.certificate.max_violation["drive_power"]  # a fraction of the bound, 0 at the bound
    if used is not None:
        print(f"drive power uses {100 * (1 + used):.1f} % of its bound")
