"""Joints of sections that bend evenly, as CasADi expressions: arcs of constant length between two rigid bodies.

The arc of the length h about a joint turns by the rotation vector φ = (0, b, a), evenly along it. In the frame of the
body at its end, with the Stumpff functions c_k(s) = Σᵢ (−s)ⁱ / (2 i + k)! of s = a² + b²,

    R = 1 + c₁ φ̂ + c₂ φ̂²        w = (1 − c₂ φ̂ + c₃ φ̂²) φ̇        p = h (c₁, −c₂ a, c₂ b)

are the rotation (parent ← child), the relative angular velocity, and the place of the arc's end relative to its
beginning (Lynch and Park, Modern Robotics, sections 3.2.3 and 3.3.3). With c_k' = ½ (k c_{k+2} − c_{k+1}) derivatives
lose no digits at small angles, as quotients by them would.
"""

from math import factorial
from typing import Any

import casadi as ca

_TERMS = 12
"""Number of terms of a series; those left out are below 1e-17 of the sum for turns up to π."""


def _stumpff(trig: Any) -> list[Any]:
    """Return c₀ to c₇: the two last by their series, the others by c_k = 1 / k! − s c_{k+2}."""
    s = trig[0] * trig[0] + trig[1] * trig[1]
    c = [ca.SX(0.0)] * 8
    for k in (7, 6):
        for i in reversed(range(_TERMS)):
            c[k] = 1.0 / factorial(2 * i + k) - s * c[k]
    for k in reversed(range(6)):
        c[k] = 1.0 / factorial(k) - s * c[k + 2]
    return c


def _slope(c: list[Any], k: int) -> Any:
    """Return the derivative of c_k by s."""
    return 0.5 * (k * c[k + 2] - c[k + 1])


class ArcJoint:
    """Joint of an arc, with the methods of a ball joint; ``trig`` begins with its bends a and b."""

    @staticmethod
    def rotation(trig: Any) -> Any:
        """Return the rotation matrix R from the body at the arc's end to that at its beginning, shape (3, 3)."""
        c = _stumpff(trig)
        turn = ca.skew(ca.vertcat(0, trig[1], trig[0]))
        return ca.SX.eye(3) + c[1] * turn + c[2] * (turn @ turn)

    @staticmethod
    def angular_velocity(trig: Any, rates: Any) -> Any:
        """Return the relative angular velocity w of the body at the arc's end, shape (3,)."""
        c = _stumpff(trig)
        across = trig[1] * rates[0] - trig[0] * rates[1]
        return ca.vertcat(-c[2] * across, rates[1] + c[3] * trig[0] * across, rates[0] - c[3] * trig[1] * across)

    @staticmethod
    def rate_bias(trig: Any, rates: Any) -> Any:
        """Return what w gains at constant rates, shape (3,)."""
        c = _stumpff(trig)
        across = trig[1] * rates[0] - trig[0] * rates[1]
        growth = 2.0 * (trig[0] * rates[0] + trig[1] * rates[1])
        second, third = growth * _slope(c, 2), growth * _slope(c, 3)
        return across * ca.vertcat(-second, third * trig[0] + c[3] * rates[0], -third * trig[1] - c[3] * rates[1])

    @staticmethod
    def torques(trig: Any, moment: Any) -> Any:
        """Return the generalised torques of the bends a, b, and zero, for a moment about the arc's end, shape (3,)."""
        a, b, c = trig[0], trig[1], _stumpff(trig)
        across = c[2] * moment[0] - c[3] * (a * moment[1] - b * moment[2])
        return ca.vertcat(moment[2] - b * across, moment[1] + a * across, 0)

    @staticmethod
    def place(trig: Any, length: Any) -> Any:
        """Return the place p of the arc's end relative to its beginning, shape (3,)."""
        c = _stumpff(trig)
        return length * ca.vertcat(c[1], -c[2] * trig[0], c[2] * trig[1])

    @staticmethod
    def place_rates(trig: Any, rates: Any, gains: Any, length: Any) -> tuple[Any, Any]:
        """Return the first and second derivatives of p by time, for the rates of the bends and theirs."""
        (a, b), (da, db), (dda, ddb) = ((each[0], each[1]) for each in (trig, rates, gains))
        c = _stumpff(trig)
        first, second = _slope(c, 1), _slope(c, 2)
        # c₁'' and c₂'' by s.
        first_curve = 0.5 * (_slope(c, 3) - second)
        second_curve = 0.5 * (2.0 * _slope(c, 4) - _slope(c, 3))
        growth = 2.0 * (a * da + b * db)
        gain = 2.0 * (da * da + db * db + a * dda + b * ddb)
        d1, d2 = first * growth, second * growth
        dd1, dd2 = first_curve * growth * growth + first * gain, second_curve * growth * growth + second * gain
        rate = ca.vertcat(d1, -d2 * a - c[2] * da, d2 * b + c[2] * db)
        curve = ca.vertcat(dd1, -dd2 * a - 2.0 * d2 * da - c[2] * dda, dd2 * b + 2.0 * d2 * db + c[2] * ddb)
        return length * rate, length * curve

    @staticmethod
    def stretching(trig: Any, force: Any, length: Any) -> Any:
        """Return the generalised torques for a force along p's own change with the bends, shape (3,)."""
        a, b, c = trig[0], trig[1], _stumpff(trig)
        along = 2.0 * (_slope(c, 1) * force[0] - _slope(c, 2) * (a * force[1] - b * force[2]))
        return length * ca.vertcat(a * along - c[2] * force[1], b * along + c[2] * force[2], 0)
