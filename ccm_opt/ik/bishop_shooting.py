"""Links that follow a curve in space, by multiple shooting of Bishop frames, which do not twist about the curve.

Lengths are in units of the arm's length. As in the plane, the turns U_i(s) = ∫ κ_i ds and their integrals over arc
length are known on every spline piece and tied from knot to knot. The frame equations, t' = κ1 n1 + κ2 n2 and n_i' =
−κ_i t, have no such closed-form solution; they are shot from joint to joint. Over a link of length h, let Ω_i be the
turn over the whole link and ψ_i the mean over the link of the turn from its start. The Magnus series then gives the
turn

    (ρ, −Ω2, Ω1) in the axes (t, n1, n2),  ρ = ψ1 Ω2 − ψ2 Ω1,

to fourth order in h; it is exact for a planar curve. Frames are unit quaternions.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.row_program import Bounds, RowBlock, equal_to_zero, pinned_bounds
from ccm_opt.ik.space_links import (
    SpaceLinks,
    axis,
    chained_quaternions,
    product,
    quaternion_axes,
    quaternions_of,
    turned_by,
)
from ccm_opt.ik.spline_curve import CurveNumbers, FollowedCurve, joint_arcs
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import SpaceConfiguration
from ccm_opt.robot.rigid_motions import exponential


@dataclass(frozen=True, eq=False)
class BishopFrames(SpaceLinks):
    """Links in space that follow a symbolic curve, whose frames are shot from joint to joint.

    Every link points along the curve's mean direction over the link, up to a fraction of the offset that the links of
    the start pose have from the nearby curve. So the start pose satisfies every constraint. The solver may reduce the
    offsets but need not.

    Attributes:
        segments: number of curvature segments of the curve.
    """

    segments: int = 1

    @cached_property
    def followed(self) -> FollowedCurve:
        """The curve whose mean directions the links have."""
        return FollowedCurve(self.segments, self.directions, joint_arcs(self.links, self.shares))

    @cached_property
    def further_symbols(self) -> dict[str, ca.SX]:
        """Symbols for the frames of the curve, the offset of the links and the direction of the tip, by name.

        They are the turn of the curve at its base, Ω, ψ and the starting frame (a quaternion) of every link, and the
        fraction of the start pose's offsets from the curve that the pose keeps ("stray").
        """
        tip = dict(self.tip_symbols)
        return {
            "base turn": ca.SX.sym("base_turn", 2),
            "turns": ca.SX.sym("turn", 2, self.links),
            "means": ca.SX.sym("mean", 2, self.links),
            "frames": ca.SX.sym("frame", 4, self.links),
            "tip parts": tip.pop("tip parts"),
            "stray": ca.SX.sym("stray"),
            **tip,
        }

    @cached_property
    def symbols(self) -> dict[str, ca.SX]:
        """All symbols of the curve, its frames, the bends and the links, by name."""
        return self.followed.symbols | self.further_symbols | {"bends": self.bends, "links": self.lies}

    @cached_property
    def parameters(self) -> dict[str, ca.SX]:
        """Parameters of the tip, and "strays", by name.

        "strays" are the offsets of the start pose's links from the mean directions of the curve, shape (2, n).
        """
        tip = dict(self.tip_parameters)
        return {"across": tip.pop("across"), "strays": ca.SX.sym("offset_from_curve", 2, self.links), **tip}

    @property
    def costs(self) -> dict[str, ca.SX]:
        """Costs of the curve and "stray", the sum of the squared angles between the links and the curve [rad²]."""
        stray = self.further_symbols["stray"] ** 2 * ca.sumsqr(self.parameters["strays"])
        return self.followed.costs | {"stray": stray}

    def rows(self) -> tuple[RowBlock, ...]:
        """Return all NLP constraints: they define the curve, turn the links and make them follow the curve.

        They define the turn of the curve over every link, the frames, the link orientations, the directions of the
        links relative to the curve and the components of the last link.
        """
        link_turns = (self._link_turns(index) for index in range(len(self.directions)))
        links = (*link_turns, self._frame_gaps(), self.turning_rows(), self._mapping(), self.tip_rows())
        return (*self.followed.rows(), *links)

    def _link_turns(self, index: int) -> RowBlock:
        """Return the NLP constraints that define the curve's turn and mean turn over every link, in one direction.

        The turn is Ω = U(s_(j+1)) − U(s_j) and the mean turn ψ = (1/h) ∫ U ds − U(s_j), where U is the integral of the
        curvature in the direction ``index`` (0 for left, 1 for up) and h the link length.
        """
        turned, integrals = self.followed.joints.at_joints(self.followed.parts[index])
        turns, means = (self.further_symbols[name][index, :].T for name in ("turns", "means"))
        gaps = ca.vertcat(
            turned[1:] - turned[:-1] - turns,
            self.per_length * (integrals[1:] - integrals[:-1]) - turned[:-1] - means,
        )
        kinds = ("turn of link {}", "mean turn of link {}")
        direction = self.directions[index]
        names = tuple(f"mapping: {kind.format(j + 1)}, {direction}" for kind in kinds for j in range(self.links))
        return equal_to_zero(names, gaps)

    def _frame_gaps(self) -> RowBlock:
        """Return the NLP constraints that propagate the curve's frame over each link, from one joint to the next."""
        left, up = ca.vertsplit(self.further_symbols["base turn"])
        frames, turns, means = (self.further_symbols[name] for name in ("frames", "turns", "means"))
        first = self.from_base(turned_by(ca.vertcat(0, -up, left)))
        left, up = ca.vertsplit(turns[:, :-1])
        mean_left, mean_up = ca.vertsplit(means[:, :-1])
        carried = product(frames[:, :-1], turned_by(ca.vertcat(mean_left * up - mean_up * left, -up, left)))
        names = tuple(f"link {link + 1}: gap in {part} of its frame" for link in range(self.links) for part in "wxyz")
        return equal_to_zero(names, ca.vec(frames - ca.horzcat(first, carried)))

    def joint_turns(self) -> ca.SX:
        """Return the quaternions of Rz(a) Ry(b) for the bends a, b of every joint, shape (4, n)."""
        return universal_turns(self.bends)

    def _mapping(self) -> RowBlock:
        """Return the NLP constraints that align every link with the curve's mean direction over it, up to an offset.

        The links of the start pose do not follow the curve exactly. Each link may therefore keep the offset of its
        direction in the start pose, times a factor in [0, 1] that all links share and that is a variable of the NLP
        ("stray"). The start pose satisfies these constraints with the factor 1, which the solver may reduce.
        """
        means, frames, stray = (self.further_symbols[name] for name in ("means", "frames", "stray"))
        directions = mean_direction(means)
        along = sum((ca.repmat(directions[k, :], 3, 1) * axis(frames, k) for k in range(3)), ca.SX(0))
        across = ca.vertcat(*(ca.sum1(axis(self.lies, k) * along) for k in (1, 2)))
        names = tuple(f"mapping of link {link + 1}, {side}" for link in range(self.links) for side in self.directions)
        return equal_to_zero(names, ca.vec(across - stray * self.parameters["strays"]))

    def joint_axes(self) -> tuple[ca.SX, ...]:
        """Return the rotation axes of every joint, z of the previous link and y of the joint's link, each (3, n)."""
        return axis(self.lies_before, 2), axis(self.lies, 1)

    def values(
        self,
        bends: FloatArray,
        feed: FloatArray,
        direction: FloatArray | None,
        beside: FloatArray | None = None,
    ) -> dict[str, FloatArray]:
        """Return the values of the symbols and parameters at a pose, by name.

        The curve is the nearest one, from which the links keep their full offsets.

        Args:
            bends: bends of the joints, shape (n, 2) [rad].
            feed: positions of the axes that carry the base, as ``feed``.
            direction: direction of the last link at the goal, shape (3,), or None.
            beside: unit vector perpendicular to the direction and to where up is at the goal, shape (3,), or None.
        """
        # A turn upwards, from x to z, is a turn about −y, so the sign of b is changed.
        curve = CurveNumbers.near(bends * np.array([1.0, -1.0]), self.segments, self.shares)
        base = self.base_turn(feed)
        lies = link_quaternions(bends, base)
        turns, means = self.link_turns(curve)
        frames = _curve_frames(curve.base_turn, turns, means, base)
        return {
            **self.followed.values(curve),
            "base turn": curve.base_turn,
            "turns": turns,
            "means": means,
            "frames": frames,
            "stray": np.ones(1),
            "strays": _offsets(frames, means, lies),
            "bends": bends,
            "links": lies,
            "feed": feed,
            **self.tip_values(lies, direction, beside),
        }

    def link_turns(self, curve: CurveNumbers) -> tuple[FloatArray, FloatArray]:
        """Return the turns Ω of a curve over every link and the mean turns ψ from the link start, each (n, 2) [rad]."""
        joints = joint_arcs(self.links, self.shares) if self.shares else np.linspace(0.0, 1.0, self.links + 1)
        flat = [curve.turned(index) for index in range(len(self.directions))]
        at_joints = np.stack([each.heading_at(joints) for each in flat], axis=1)
        integrals = np.stack([each.heading_integral_at(joints) for each in flat], axis=1)
        return np.diff(at_joints, axis=0), np.diff(integrals, axis=0) * np.array(self.per_length) - at_joints[:-1]

    def bounds(self, last: FloatArray, direction: FloatArray | None, turned: float, rolled: float = 0.0) -> Bounds:
        """Return the bounds of the curve, the last link's direction and the links' offsets from the curve, by name.

        Turns start at 0, and the fraction of the offsets that remains lies in [0, 1].

        Args:
            last: unused.
            direction: direction of the last link at the goal, shape (3,), or None for no bounds on the components.
            turned: tolerance of the last link's direction [rad].
            rolled: tolerance of its roll [rad]; above a right angle, the roll is not held.
        """
        del last
        turns = np.append(0.0, np.full(self.followed.parts[0].count, np.inf))
        return {
            **self.followed.bounds(),
            **{f"turned {name}": pinned_bounds(turns) for name in self.directions},
            "stray": (np.zeros(1), np.ones(1)),
            **self.tip_bounds(direction, turned, rolled),
        }

    def curve(self, arm: Arm, values: Mapping[str, FloatArray], q: FloatArray) -> SpaceConfiguration:
        """Return the curve that the links follow as a curve in space, in metres and world axes.

        Args:
            arm: the arm.
            values: values of the symbols by name.
            q: configuration with the positions of the axes that carry the base, shape (c,) [rad, m].
        """
        return curve_in_space(arm, self.followed.numbers(values), q)


def curve_in_space(arm: Arm, numbers: CurveNumbers, q: FloatArray) -> SpaceConfiguration:
    """Return a curve of length 1 in base axes as a curve in space, in metres and world axes.

    Args:
        arm: the arm.
        numbers: the curve.
        q: configuration with the positions of the axes that carry the base, shape (c,) [rad, m].
    """
    lengths, values, shares = numbers.parts()
    left, up = numbers.base_turn
    rotation, _ = exponential(np.array([0.0, -up, left, 0.0, 0.0, 0.0]))
    base = arm.carried(q)
    return SpaceConfiguration.chain(
        base.place,
        base.rotation @ rotation,
        [arm.length * length for length in lengths],
        [value / arm.length for value in values],
        shares,
    )


def mean_direction(means: ca.SX) -> ca.SX:
    """Return the mean direction of a curve over each of n links, in the frame at the start of the link, shape (3, n).

    Args:
        means: symbols of the mean turns ψ over each link from the link's start, shape (2, n) [rad].
    """
    # A smooth lower bound, far below any relevant angle, so that sin(x)/x has a derivative at 0.
    angle = ca.sqrt(ca.sum1(means**2) + 1e-16)
    return ca.vertcat(ca.cos(angle), ca.repmat(ca.sin(angle) / angle, 2, 1) * means)


def link_quaternions(bends: FloatArray, base: FloatArray | None = None) -> FloatArray:
    """Return the quaternions of n links relative to the straight arm, shape (n, 4).

    Args:
        bends: bends of the joints, shape (n, 2) [rad].
        base: quaternion of the base, shape (4,); None if it is not turned.
    """
    zero = np.zeros(len(bends))
    about_z = quaternions_of(np.column_stack((zero, zero, bends[:, 0])))
    about_y = quaternions_of(np.column_stack((zero, bends[:, 1], zero)))
    return chained_quaternions(np.stack((about_z, about_y), axis=1).reshape(-1, 4), base)[1::2]


def _curve_frames(base_turn: FloatArray, turns: FloatArray, means: FloatArray, base: FloatArray) -> FloatArray:
    """Return the frames of a curve at the starts of n links as quaternions, shape (n, 4).

    Args:
        base_turn: turns of the curve at its base to the left and upwards, shape (2,) [rad].
        turns: turns Ω over every link, shape (n, 2) [rad].
        means: mean turns ψ over every link from the link's start, shape (n, 2) [rad].
        base: quaternion of the base, shape (4,).
    """
    roll = means[:, 0] * turns[:, 1] - means[:, 1] * turns[:, 0]
    steps = np.column_stack((roll, -turns[:, 1], turns[:, 0]))[:-1]
    first = np.array([[0.0, -base_turn[1], base_turn[0]]])
    return chained_quaternions(quaternions_of(np.concatenate((first, steps))), base)


def _offsets(frames: FloatArray, means: FloatArray, lies: FloatArray) -> FloatArray:
    """Return the components, along each link's y and z axes, of the curve's mean direction over the link, shape (n, 2).

    Args:
        frames: quaternions of the curve's frames at the starts of the links, shape (n, 4).
        means: mean turns ψ over every link from the link's start, shape (n, 2) [rad].
        lies: quaternions of the links, shape (n, 4).
    """
    size = np.linalg.norm(means, axis=1)
    local = np.concatenate((np.cos(size)[:, None], np.sinc(size / np.pi)[:, None] * means), axis=1)
    mean = sum(local[:, [k]] * along for k, along in enumerate(quaternion_axes(frames)))
    return np.stack([np.sum(along * mean, axis=1) for along in quaternion_axes(lies)[1:]], axis=1)


def universal_turns(bends: ca.SX) -> ca.SX:
    """Return the quaternions of Rz(a) Ry(b), shape (4, n), for symbolic joint bends (a, b), shape (2, n) [rad]."""
    half_a = bends[0, :] / 2
    half_b = bends[1, :] / 2
    return ca.vertcat(
        ca.cos(half_a) * ca.cos(half_b),
        -ca.sin(half_a) * ca.sin(half_b),
        ca.cos(half_a) * ca.sin(half_b),
        ca.sin(half_a) * ca.cos(half_b),
    )
