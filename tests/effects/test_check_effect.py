"""The public check of effects: it passes every effect of the table and catches faulty ones."""

from __future__ import annotations

import pytest

from energy_opt.effects import ALL_EFFECTS, CoulombFriction, MeterDelay, Parameter, ViscousFriction
from energy_opt.effects.check import check_effect


@pytest.mark.parametrize("kind", ALL_EFFECTS, ids=lambda kind: kind.name)
def test_every_effect_passes(kind):
    assert check_effect(kind) == []


def test_an_effect_that_never_is_neutral_is_caught():
    class Offset(ViscousFriction):
        @classmethod
        def torque(cls, x, p, k):
            return p.b * x.v + 0.01

    assert any("neutral" in fault for fault in check_effect(Offset))


def test_an_effect_that_gives_power_is_caught():
    class Push(CoulombFriction):
        @classmethod
        def torque(cls, x, p, k):
            return -p.tau_c * k.sign(x.v, 0.01)

    assert any("dissipate" in fault for fault in check_effect(Push))


def test_a_wrong_derivative_is_caught():
    class Wrong(MeterDelay):
        @classmethod
        def sensitivity(cls, time, power, value):
            return 1.1 * super().sensitivity(time, power, value)

    assert any("finite differences" in fault for fault in check_effect(Wrong))


def test_parameters_with_equal_influence_are_reported():
    class Twice(ViscousFriction):
        parameters = (*ViscousFriction.parameters, Parameter("c", "N m s/rad", 0.0, 0.0, 1e4, "joint"))

        @classmethod
        def torque(cls, x, p, k):
            return (p.b + p.c) * x.v

    assert any("recovered" in fault for fault in check_effect(Twice))
