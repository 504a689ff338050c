"""Algebra of links and ball joints for the dynamics, as CasADi expressions.

The angles of a ball joint are (a, b, c) = (θ1, θ2, θ3); every vector is given in the frame of the child link, whose x
axis lies along the link. With R = Rz(a) Ry(b) Rx(c) or Rz(a) Ry(b) Rz(c) the relative angular velocity is w = S(q) q̇,
and the moment n of the ball joint gives the revolute torques τ = Sᵀ n (Featherstone, Rigid Body Dynamics Algorithms,
2008, section 4.4). The determinant of S is −cos b (zyx) or −sin b (zyz).

A link is symmetric about the x axis of its frame, so few terms of each product remain.
"""

from collections.abc import Callable
from inspect import signature
from typing import Any, TypeAlias

import casadi as ca

from ccm_opt.robot.arm import Axes


class YawBendRoll:
    """Ball joint with axes Z-Y-X; the columns of S are (−sb, cb sc, cb cc), (0, cc, −sc), (1, 0, 0)."""

    @staticmethod
    def rotation(trig: Any) -> Any:
        """Return the rotation matrix R = Rz(a) Ry(b) Rx(c) from the child link to its parent, shape (3, 3)."""
        sa, c_a, sb, cb, sc, cc = _sines(trig)
        yaw_bend = c_a * sb
        sine_bend = sa * sb
        return _matrix(
            (c_a * cb, yaw_bend * sc - sa * cc, yaw_bend * cc + sa * sc),
            (sa * cb, sine_bend * sc + c_a * cc, sine_bend * cc - c_a * sc),
            (-sb, cb * sc, cb * cc),
        )

    @staticmethod
    def angular_velocity(trig: Any, rates: Any) -> Any:
        """Return the relative angular velocity w = S q̇ of the child link, shape (3,)."""
        _, _, sb, cb, sc, cc = _sines(trig)
        yaw = cb * rates[0]
        return ca.vertcat(rates[2] - sb * rates[0], yaw * sc + cc * rates[1], yaw * cc - sc * rates[1])

    @staticmethod
    def rate_bias(trig: Any, rates: Any) -> Any:
        """Return the velocity product Ṡ q̇ of the ball joint, shape (3,)."""
        _, _, sb, cb, sc, cc = _sines(trig)
        # The derivative of S q̇ at constant rates, its terms gathered by cos c and sin c.
        yaw, bend, roll = ca.vertsplit(rates)
        along = sb * yaw * bend + bend * roll
        across = cb * yaw * roll
        return ca.vertcat(-cb * yaw * bend, across * cc - along * sc, -across * sc - along * cc)

    @staticmethod
    def torques(trig: Any, moment: Any) -> Any:
        """Return the revolute torques τ = Sᵀ n for a moment n of the ball joint, shape (3,)."""
        _, _, sb, cb, sc, cc = _sines(trig)
        across = sc * moment[1] + cc * moment[2]
        return ca.vertcat(cb * across - sb * moment[0], cc * moment[1] - sc * moment[2], moment[0])


class YawBendSpin:
    """Ball joint with axes Z-Y-Z; the columns of S are (−sb cc, sb sc, cb), (sc, cc, 0), (0, 0, 1)."""

    @staticmethod
    def rotation(trig: Any) -> Any:
        """Return the rotation matrix R = Rz(a) Ry(b) Rz(c) from the child link to its parent, shape (3, 3)."""
        sa, c_a, sb, cb, sc, cc = _sines(trig)
        yaw_bend = c_a * cb
        sine_bend = sa * cb
        return _matrix(
            (yaw_bend * cc - sa * sc, -yaw_bend * sc - sa * cc, c_a * sb),
            (sine_bend * cc + c_a * sc, c_a * cc - sine_bend * sc, sa * sb),
            (-sb * cc, sb * sc, cb),
        )

    @staticmethod
    def angular_velocity(trig: Any, rates: Any) -> Any:
        """Return the relative angular velocity w = S q̇ of the child link, shape (3,)."""
        _, _, sb, cb, sc, cc = _sines(trig)
        yaw = sb * rates[0]
        return ca.vertcat(sc * rates[1] - yaw * cc, yaw * sc + cc * rates[1], cb * rates[0] + rates[2])

    @staticmethod
    def rate_bias(trig: Any, rates: Any) -> Any:
        """Return the velocity product Ṡ q̇ of the ball joint, shape (3,)."""
        _, _, sb, cb, sc, cc = _sines(trig)
        # The derivative of S q̇ at constant rates, its terms gathered by cos c and sin c.
        yaw, bend, spin = ca.vertsplit(rates)
        along = bend * spin - cb * yaw * bend
        across = sb * yaw * spin
        return ca.vertcat(along * cc + across * sc, across * cc - along * sc, -sb * yaw * bend)

    @staticmethod
    def torques(trig: Any, moment: Any) -> Any:
        """Return the revolute torques τ = Sᵀ n for a moment n of the ball joint, shape (3,)."""
        _, _, sb, cb, sc, cc = _sines(trig)
        across = sc * moment[1] - cc * moment[0]
        return ca.vertcat(sb * across + cb * moment[2], sc * moment[0] + cc * moment[1], moment[2])


BallJoint: TypeAlias = type[YawBendRoll | YawBendSpin]
"""Class with the algebra of a ball joint of a given order of axes.

From the three sines and then the three cosines of its angles, shape (6,), the class computes R (parent ← child), (3,
3), w = S q̇, the velocity product Ṡ q̇, and the torques Sᵀ n, each (3,).
"""
BALL_JOINTS: dict[Axes, BallJoint] = {"zyx": YawBendRoll, "zyz": YawBendSpin}


def _sines(trig: Any) -> tuple[Any, ...]:
    """Return (sin a, cos a, sin b, cos b, sin c, cos c) from three sines followed by three cosines."""
    return tuple(trig[k + 3 * cosine] for k in range(3) for cosine in (0, 1))


def _matrix(*rows: tuple[Any, Any, Any]) -> Any:
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def centripetal(omega: Any) -> Any:
    """Return ω × (ω × x̂), shape (3,): the acceleration due to ω of a point at unit distance along x."""
    x, y, z = ca.vertsplit(omega)
    return ca.vertcat(-y * y - z * z, x * y, x * z)


COLUMNS = {
    "trig": 6,
    "qd": 3,
    "qdd": 3,
    "tau": 3,
    "motion": 6,
    "load": 6,
    "solved": 21,
    "body": 4,
    "drive": 6,
    "attached": 10,
    "world": 5,
}
"""Sizes of the arguments of link functions, by argument name; all others are single numbers.

In order: sines and then cosines of the ball joint, rates, accelerations and torques of its revolutes, (ω, β), (F, N),
the intermediate results that the acceleration sweep needs, and body, drives, attached and world as in ``ArmModel``.
"""


def attached_parts(attached: Any) -> tuple[Any, Any, Any]:
    """Return mass, first moment (3,) and moments of inertia (3, 3) of what is fixed to a link, about its end."""
    xx, xy, xz, yy, yz, zz = ca.vertsplit(attached[4:])
    return attached[0], attached[1:4], _matrix((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))


def link_function(name: str, of: Callable[..., tuple[Any, ...]], **sizes: int) -> Any:
    """Build a CasADi function of one link from a Python function, whose argument names determine the sizes.

    Args:
        name: name of the CasADi function.
        of: Python function from columns to columns.
        **sizes: size of the state that one link passes to the next, and of what differs from ``COLUMNS``.
    """
    columns = [ca.SX.sym(column, {**COLUMNS, **sizes}.get(column, 1)) for column in signature(of).parameters]
    return ca.Function(name, columns, list(of(*columns)))


def shared_terms(function: Any) -> Any:
    """Return a CasADi function that computes terms which occur more than once a single time."""
    columns = function.sx_in()
    return ca.Function(function.name(), columns, ca.cse(list(function(*columns))))
