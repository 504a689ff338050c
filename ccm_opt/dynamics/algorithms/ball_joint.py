"""Expressions of one ball joint: rotation, rates and torques for each order of the three revolutes.

Angles (a, b, c) = (θ1, θ2, θ3); every vector is given in the frame of the child link, whose x axis lies along the link.
With R = Rz(a) Ry(b) Rx(c) or Rz(a) Ry(b) Rz(c) the relative angular velocity is w = S(q) q̇, and the ball's moment n
gives the revolute torques τ = Sᵀ n (Featherstone, Rigid Body Dynamics Algorithms, 2008, section 4.4). S is inverted in
closed form; its determinant is −cos b (zyx) or −sin b (zyz).
"""

from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca

from ccm_opt.jointed.arm import Axes


@dataclass(frozen=True)
class Angles:
    """Sines and cosines of the three angles of a ball, (3,) CasADi expressions each."""

    sin: Any
    cos: Any

    @property
    def all(self) -> tuple[Any, Any, Any, Any, Any, Any]:
        """(sin a, cos a, sin b, cos b, sin c, cos c)."""
        return self.sin[0], self.cos[0], self.sin[1], self.cos[1], self.sin[2], self.cos[2]


class BallJoint(Protocol):
    """The algebra of a ball joint whose three revolutes turn about given axes."""

    @staticmethod
    def rotation(angles: Angles) -> Any:
        """R, parent ← child, (3, 3)."""

    @staticmethod
    def angular_velocity(angles: Angles, rates: Any) -> Any:
        """Relative angular velocity w = S q̇, (3,)."""

    @staticmethod
    def rate_bias(angles: Angles, rates: Any) -> Any:
        """Velocity product Ṡ q̇, (3,)."""

    @staticmethod
    def revolute_rates(angles: Angles, vector: Any) -> Any:
        """S⁻¹ applied to a vector, (3,)."""

    @staticmethod
    def torques(angles: Angles, moment: Any) -> Any:
        """Revolute torques Sᵀ n, (3,)."""

    @staticmethod
    def moment(angles: Angles, torques: Any) -> Any:
        """Moment n = S⁻ᵀ τ, (3,)."""


class YawBendRoll:
    """Z-Y-X: S has the columns (−sb, cb sc, cb cc), (0, cc, −sc), (1, 0, 0)."""

    @staticmethod
    def rotation(angles: Angles) -> Any:
        """R = Rz(a) Ry(b) Rx(c)."""
        sa, c_a, sb, cb, sc, cc = angles.all
        yaw_bend = c_a * sb
        sine_bend = sa * sb
        return _matrix(
            (c_a * cb, yaw_bend * sc - sa * cc, yaw_bend * cc + sa * sc),
            (sa * cb, sine_bend * sc + c_a * cc, sine_bend * cc - c_a * sc),
            (-sb, cb * sc, cb * cc),
        )

    @staticmethod
    def angular_velocity(angles: Angles, rates: Any) -> Any:
        """S q̇."""
        _, _, sb, cb, sc, cc = angles.all
        yaw = cb * rates[0]
        return ca.vertcat(rates[2] - sb * rates[0], yaw * sc + cc * rates[1], yaw * cc - sc * rates[1])

    @staticmethod
    def rate_bias(angles: Angles, rates: Any) -> Any:
        """Ṡ q̇."""
        _, _, sb, cb, sc, cc = angles.all
        # The derivative of S q̇ at constant rates, its terms gathered by cos c and sin c.
        yaw, bend, roll = ca.vertsplit(rates)
        along = sb * yaw * bend + bend * roll
        across = cb * yaw * roll
        return ca.vertcat(-cb * yaw * bend, across * cc - along * sc, -across * sc - along * cc)

    @staticmethod
    def revolute_rates(angles: Angles, vector: Any) -> Any:
        """S⁻¹ w; divides by cos b."""
        _, _, sb, cb, sc, cc = angles.all
        # Turned back by c, the z component of w is cos b times the yaw rate, and nothing else.
        yaw = (sc * vector[1] + cc * vector[2]) / cb
        return ca.vertcat(yaw, cc * vector[1] - sc * vector[2], vector[0] + sb * yaw)

    @staticmethod
    def torques(angles: Angles, moment: Any) -> Any:
        """Sᵀ n."""
        _, _, sb, cb, sc, cc = angles.all
        across = sc * moment[1] + cc * moment[2]
        return ca.vertcat(cb * across - sb * moment[0], cc * moment[1] - sc * moment[2], moment[0])

    @staticmethod
    def moment(angles: Angles, torques: Any) -> Any:
        """S⁻ᵀ τ; divides by cos b."""
        _, _, sb, cb, sc, cc = angles.all
        across = (torques[0] + sb * torques[2]) / cb
        return ca.vertcat(torques[2], sc * across + cc * torques[1], cc * across - sc * torques[1])


class YawBendSpin:
    """Z-Y-Z: S has the columns (−sb cc, sb sc, cb), (sc, cc, 0), (0, 0, 1)."""

    @staticmethod
    def rotation(angles: Angles) -> Any:
        """R = Rz(a) Ry(b) Rz(c)."""
        sa, c_a, sb, cb, sc, cc = angles.all
        yaw_bend = c_a * cb
        sine_bend = sa * cb
        return _matrix(
            (yaw_bend * cc - sa * sc, -yaw_bend * sc - sa * cc, c_a * sb),
            (sine_bend * cc + c_a * sc, c_a * cc - sine_bend * sc, sa * sb),
            (-sb * cc, sb * sc, cb),
        )

    @staticmethod
    def angular_velocity(angles: Angles, rates: Any) -> Any:
        """S q̇."""
        _, _, sb, cb, sc, cc = angles.all
        yaw = sb * rates[0]
        return ca.vertcat(sc * rates[1] - yaw * cc, yaw * sc + cc * rates[1], cb * rates[0] + rates[2])

    @staticmethod
    def rate_bias(angles: Angles, rates: Any) -> Any:
        """Ṡ q̇."""
        _, _, sb, cb, sc, cc = angles.all
        # The derivative of S q̇ at constant rates, its terms gathered by cos c and sin c.
        yaw, bend, spin = ca.vertsplit(rates)
        along = bend * spin - cb * yaw * bend
        across = sb * yaw * spin
        return ca.vertcat(along * cc + across * sc, across * cc - along * sc, -sb * yaw * bend)

    @staticmethod
    def revolute_rates(angles: Angles, vector: Any) -> Any:
        """S⁻¹ w; divides by sin b."""
        _, _, sb, cb, sc, cc = angles.all
        # Turned back by c, the x component of w is −sin b times the yaw rate, and nothing else.
        yaw = (sc * vector[1] - cc * vector[0]) / sb
        return ca.vertcat(yaw, sc * vector[0] + cc * vector[1], vector[2] - cb * yaw)

    @staticmethod
    def torques(angles: Angles, moment: Any) -> Any:
        """Sᵀ n."""
        _, _, sb, cb, sc, cc = angles.all
        across = sc * moment[1] - cc * moment[0]
        return ca.vertcat(sb * across + cb * moment[2], sc * moment[0] + cc * moment[1], moment[2])

    @staticmethod
    def moment(angles: Angles, torques: Any) -> Any:
        """S⁻ᵀ τ; divides by sin b."""
        _, _, sb, cb, sc, cc = angles.all
        across = (torques[0] - cb * torques[2]) / sb
        return ca.vertcat(sc * torques[1] - cc * across, sc * across + cc * torques[1], torques[2])


BALL_JOINTS: dict[Axes, BallJoint] = {"zyx": YawBendRoll(), "zyz": YawBendSpin()}


def _matrix(*rows: tuple[Any, Any, Any]) -> Any:
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))
