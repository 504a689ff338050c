"""State of a motion under servo control: its last control points, and how it is braked; the B-spline that they make."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ccm_opt.core.arrays import FloatArray


@dataclass(frozen=True)
class TipVelocity:
    """Commanded motion of the tip in d dimensions, whose links turn about t axes (1 in the plane, 3 in space).

    Attributes:
        linear: velocity, shape (d,) [length/s].
        angular: angular velocity about the controlled axes, shape (k,) [rad/s]; None if the tip may turn freely.
        axes: unit vectors of the k axes about which the tip's turns are controlled, shape (k, t); all if None.
    """

    linear: FloatArray
    angular: FloatArray | None = None
    axes: FloatArray | None = None

    @property
    def at_rest(self) -> bool:
        """Whether the tip is to stand still."""
        return not np.any(self.linear) and (self.angular is None or not np.any(self.angular))


@dataclass(frozen=True)
class Cut:
    """Reason why the tip moves otherwise than commanded.

    Attributes:
        kind: "contact", "clearance" for a soft push away from a body, "joint limit", "base range", "guide tube",
            "turn", "velocity", "acceleration", "effort", "certificate", "stretched", or "unsolved" where no change was
            found.
        name: coordinate or drive at its limit, or the two bodies that are near each other.
        value: value that the motion has, or would have: a gap [length], a bend or position, a rate or an effort.
        limit: value that it may have; 0 for a gap.
        unit: unit of both values.
    """

    kind: str
    name: str
    value: float
    limit: float
    unit: str


@dataclass(frozen=True, eq=False)
class Braking:
    """Certified continuation of a motion to rest.

    Attributes:
        unknowns: unknowns of the control points still to come, shape (m, p).
        controls: control points still to come, of which the last is the pose at rest, shape (m, c).
    """

    unknowns: FloatArray
    controls: FloatArray


@dataclass(frozen=True, eq=False)
class ServoState:
    """State of a motion at the beginning of a tick.

    Attributes:
        controls: the last three control points, shape (3, c): their spline begins the tick.
        unknowns: unknowns of the last two control points, shape (2, p).
        braking: certified continuation to rest.
    """

    controls: FloatArray
    unknowns: FloatArray
    braking: Braking

    @property
    def moving(self) -> bool:
        """Whether the arm moves, or is about to."""
        held = self.braking.controls
        return bool(np.any(np.diff(self.controls, axis=0))) or len(held) > 0

    def continued(self) -> "ServoState":
        """Return the state after a tick of the held braking."""
        held = self.braking
        control, v = (held.controls[0], held.unknowns[0]) if len(held.controls) else (self.controls[-1], None)
        unknowns = self.unknowns[[1, 1]] if v is None else np.stack((self.unknowns[1], v))
        return ServoState(
            np.vstack((self.controls[1:], control)), unknowns, Braking(held.unknowns[1:], held.controls[1:])
        )

    def taking(self, braking: Braking) -> "ServoState":
        """Return the state after a tick to the first control point of a continuation."""
        return replace(self, braking=braking).continued()

    def to_rest(self) -> FloatArray:
        """Return all control points to the end of the held braking, from the three of this state, shape (m + 5, c)."""
        rest = self.braking.controls[-1:] if len(self.braking.controls) else self.controls[-1:]
        return np.vstack((self.controls, self.braking.controls, rest, rest))


def spline_values(controls: FloatArray, period: float, share: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions, velocities and accelerations of a uniform cubic B-spline at a share of each of its spans.

    Args:
        controls: control points, shape (m + 3, c).
        period: duration of a span [s].
        share: time in the span as a fraction of its duration, from 0 to 1.

    Returns:
        Three arrays of shape (m, c).
    """
    spans = len(controls) - 3
    position, velocity, acceleration = (
        sum(weight * controls[k : spans + k] for k, weight in enumerate(row)) for row in spline_weights(share)
    )
    return position, velocity / period, acceleration / period**2


def knot_values(controls: FloatArray, period: float) -> tuple[FloatArray, ...]:
    """Return positions, velocities and accelerations at the m + 1 ends of all spans, three arrays of shape (m + 1, c).

    Arguments are those of ``spline_values``.
    """
    begins, ends = spline_values(controls, period, 0.0), spline_values(controls[-4:], period, 1.0)
    return tuple(np.vstack(each) for each in zip(begins, ends, strict=True))


@lru_cache(maxsize=256)
def spline_weights(share: float) -> FloatArray:
    """Return the weights of four control points in position, velocity and acceleration at a share of a span, (3, 4).

    Velocity and acceleration are per duration of a span and its square.
    """
    s, r = share, 1.0 - share
    position = np.array([r**3, 3 * s**3 - 6 * s**2 + 4, 3 * r**3 - 6 * r**2 + 4, s**3]) / 6.0
    velocity = np.array([-(r**2), 3 * s**2 - 4 * s, 4 * r - 3 * r**2, s**2]) / 2.0
    acceleration = np.array([r, 3 * s - 2, 3 * r - 2, s])
    return np.stack((position, velocity, acceleration))
