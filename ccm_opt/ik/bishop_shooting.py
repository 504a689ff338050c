"""Links that follow a curve in space, by multiple shooting of Bishop frames, which do not twist about the curve.

Lengths are in units of the arm's length. As in the plane, the turns U_i(s) = ∫ κ_i ds and their integrals over arc
length are known on every spline piece and tied from knot to knot. The frame equations, t' = κ1 n1 + κ2 n2 and n_i' =
−κ_i t, have no such closed-form solution; they are shot from joint to joint. Over a link of length h, let Ω_i be the
turn over the whole link and ψ_i the mean over the link of the turn from its start. The Magnus series then gives the
turn

    (ρ, −Ω2, Ω1) in the axes (t, n1, n2),  ρ = ψ1 Ω2 − ψ2 Ω1,

to fourth order in h; it is exact for a planar curve. Frames are unit quaternions (w, x, y, z).
"""

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.curve_frames import Bounds, CurveFrames, CurveNumbers, pinned_bounds
from ccm_opt.ik.row_program import RowBlock, equal_to_zero
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import SpaceConfiguration
from ccm_opt.robot.rigid_motions import exponential


def product(first: ca.SX, second: ca.SX) -> Any:
    """Return the Hamilton products of symbolic quaternions, column by column, shape (4, n).

    The rotation of the product is the first, followed by the second in the axes of the first. Both have shape (4, n).
    """
    return ca.vertcat(*_quaternion_product(ca.vertsplit(first), ca.vertsplit(second)))


def _quaternion_product(first: Iterable[Any], second: Iterable[Any]) -> tuple[Any, Any, Any, Any]:
    """Return the components of the Hamilton product of two quaternions, given as symbols or numbers."""
    w, x, y, z = first
    a, b, c, d = second
    return (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )


def turned_by(vectors: ca.SX) -> ca.SX:
    """Return the quaternions, shape (4, n), of symbolic rotation vectors, shape (3, n) [rad]."""
    angle = ca.sqrt(ca.sum1(vectors**2) + 1e-16)  # smooth at zero, and elsewhere exact up to rounding
    share = ca.sin(angle / 2) / angle
    return ca.vertcat(ca.cos(angle / 2), ca.repmat(share, 3, 1) * vectors)


def axis(quaternions: ca.SX, number: int) -> ca.SX:
    """Return an axis turned by each of n symbolic unit quaternions, shape (3, n).

    Args:
        quaternions: the quaternions, shape (4, n).
        number: 0 for the x axis, 1 for y, 2 for z.
    """
    w, x, y, z = ca.vertsplit(quaternions)
    if number == 0:
        return ca.vertcat(w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y))
    if number == 1:
        return ca.vertcat(2 * (x * y - w * z), w**2 - x**2 + y**2 - z**2, 2 * (y * z + w * x))
    return ca.vertcat(2 * (x * z + w * y), 2 * (y * z - w * x), w**2 - x**2 - y**2 + z**2)


def chained_quaternions(turns: FloatArray) -> FloatArray:
    """Return the cumulative products of numerical quaternions, from the first to each, both of shape (n, 4).

    The products are not normalised to a sign (q and −q are the same rotation), so they change continuously with the
    arguments.
    """
    chained = np.empty_like(turns)
    latest = np.array([1.0, 0.0, 0.0, 0.0])
    for step, turn in enumerate(turns):
        latest = np.array(_quaternion_product(latest, turn))
        chained[step] = latest
    return chained


def quaternions_of(vectors: FloatArray) -> FloatArray:
    """Return the quaternions, shape (n, 4), of numerical rotation vectors, shape (n, 3) [rad]."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.concatenate((np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors), axis=1)


class BishopFrames(CurveFrames):
    """Links in space as unit quaternions that follow a symbolic curve, whose frames are shot from joint to joint.

    Every link points along the curve's mean direction over the link, up to a fraction of the offset that the links of
    the start pose have from the nearby curve. So the start pose satisfies every constraint. The solver may reduce the
    offsets but need not.
    """

    directions = ("left", "up")
    start_keeps_rows = True

    @cached_property
    def lies(self) -> ca.SX:
        """Unit quaternions that turn the axes of the straight arm into those of each of the n links, shape (4, n)."""
        return ca.SX.sym("link", 4, self.links)

    @cached_property
    def further_symbols(self) -> dict[str, ca.SX]:
        """Symbols for the frames of the curve, the direction of the tip and the offset of the links, by name.

        They are the turn of the curve at its base, Ω, ψ and the starting frame (a quaternion) of every link, the
        components of the last link along two axes perpendicular to the goal direction ("tip parts"), the fraction of
        the start pose's offsets from the curve that the pose keeps ("stray") and, for a goal with a roll, the component
        of the up axis of the last link perpendicular to the goal's direction and to where up is ("tip roll").
        """
        rolled = {"tip roll": ca.SX.sym("tip_roll")} if self.up else {}
        return {
            "base turn": ca.SX.sym("base_turn", 2),
            "turns": ca.SX.sym("turn", 2, self.links),
            "means": ca.SX.sym("mean", 2, self.links),
            "frames": ca.SX.sym("frame", 4, self.links),
            "tip parts": ca.SX.sym("tip_part", 2),
            "stray": ca.SX.sym("stray"),
            **rolled,
        }

    @cached_property
    def parameters(self) -> dict[str, ca.SX]:
        """Symbols for two unit vectors perpendicular to the goal direction, and for the start pose's offsets, by name.

        "across" are the vectors, shape (3, 2); "strays" are the offsets of the start pose's links from the mean
        directions of the curve, shape (2, n). For a goal with a roll, "beside" is the unit vector perpendicular to the
        goal's direction and to where up is.
        """
        found = {"across": ca.SX.sym("across", 3, 2), "strays": ca.SX.sym("offset_from_curve", 2, self.links)}
        return found | ({"beside": ca.SX.sym("beside", 3)} if self.up else {})

    @property
    def costs(self) -> dict[str, ca.SX]:
        """Cost "stray", the sum of the squared angles between the links and the curve [rad²]."""
        return {"stray": self.further_symbols["stray"] ** 2 * ca.sumsqr(self.parameters["strays"])}

    def link_rows(self) -> tuple[RowBlock, ...]:
        """Return the NLP constraints that turn the links by the bends of their joints and make them follow the curve.

        They define the turn of the curve over every link, the frames, the link orientations, the directions of the
        links relative to the curve and the components of the last link.
        """
        link_turns = (self._link_turns(index) for index in range(len(self.directions)))
        return (*link_turns, self._frame_gaps(), self._turning(), self._mapping(), self._tip_parts())

    def _link_turns(self, index: int) -> RowBlock:
        """Return the NLP constraints that define the curve's turn and mean turn over every link, in one direction.

        The turn is Ω = U(s_(j+1)) − U(s_j) and the mean turn ψ = (1/h) ∫ U ds − U(s_j), where U is the integral of the
        curvature in the direction ``index`` (0 for left, 1 for up) and h the link length.
        """
        turned, integrals = self.joints.at_joints(self.parts[index])
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
        first = turned_by(ca.vertcat(0, -up, left))
        left, up = ca.vertsplit(turns[:, :-1])
        mean_left, mean_up = ca.vertsplit(means[:, :-1])
        carried = product(frames[:, :-1], turned_by(ca.vertcat(mean_left * up - mean_up * left, -up, left)))
        names = tuple(f"link {link + 1}: gap in {part} of its frame" for link in range(self.links) for part in "wxyz")
        return equal_to_zero(names, ca.vec(frames - ca.horzcat(first, carried)))

    def _turning(self) -> RowBlock:
        """Return the NLP constraints R_j = R_(j−1) Rz(a_j) Ry(b_j), which turn every link by the bends of its joint."""
        turns = _turns(self.bends)
        turned = product(self.lies[:, :-1], turns[:, 1:])
        names = tuple(f"link {link + 1}: gap in {part} of its turn" for link in range(self.links) for part in "wxyz")
        return equal_to_zero(names, ca.vec(self.lies - ca.horzcat(turns[:, 0], turned)))

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

    def _tip_parts(self) -> RowBlock:
        """Return the NLP constraints that define the components of the last link perpendicular to the goal direction.

        For a goal with a roll, another one defines the component of its up axis. Bounds on these components keep the
        link within the tolerance of the goal.
        """
        names = ("tip: gap in its direction", "tip: gap in its direction, across")
        parts = self.parameters["across"].T @ self.direction(self.lies)[:, self.links - 1]
        gaps = parts - self.further_symbols["tip parts"]
        if not self.up:
            return equal_to_zero(names, gaps)
        axes = self.link_axes(self.lies[:, self.links - 1])
        above = sum((number * each for number, each in zip(self.up, axes, strict=True)), ca.SX(0))
        rolled = ca.dot(self.parameters["beside"], above) - self.further_symbols["tip roll"]
        return equal_to_zero((*names, "tip: gap in its roll"), ca.vertcat(gaps, rolled))

    def link_axes(self, lies: ca.SX) -> tuple[ca.SX, ...]:
        """Return the axes of links, each of shape (3, e), from their quaternions, shape (4, e)."""
        return axis(lies, 0), axis(lies, 1), axis(lies, 2)

    def joint_axes(self) -> tuple[ca.SX, ...]:
        """Return the rotation axes of every joint, z of the previous link and y of the joint's link, each (3, n)."""
        return ca.horzcat(ca.SX([0.0, 0.0, 1.0]), axis(self.lies[:, :-1], 2)), axis(self.lies, 1)

    def turns_of(self, bends: FloatArray) -> FloatArray:
        """Return the turns to the left and upwards for joint bends (a, b), both of shape (n, 2) [rad].

        A turn upwards, from x to z, is a turn about −y, so the sign of b is changed.
        """
        return np.asarray(bends * np.array([1.0, -1.0]))

    def lies_at(self, bends: FloatArray) -> FloatArray:
        """Return the quaternions of the links, shape (n, 4), for joint bends of shape (n, 2) [rad]."""
        return link_quaternions(bends)

    def values(
        self, curve: CurveNumbers, lies: FloatArray, direction: FloatArray | None, beside: FloatArray | None = None
    ) -> dict[str, FloatArray]:
        """Return the values of the frames' symbols and parameters at the start pose, by name.

        With these values, the links keep their full offsets from the curve.

        Args:
            curve: a curve near the start pose.
            lies: quaternions of the links of the start pose, shape (n, 4).
            direction: direction of the last link at the goal, shape (3,), or None.
            beside: unit vector perpendicular to the direction and to where up is at the goal, shape (3,), or None.
        """
        turns, means = self.link_turns(curve)
        frames = _curve_frames(curve.base_turn, turns, means)
        across = _across(direction)
        rolled = {}
        if self.up and beside is not None:
            above = np.array(self.up) @ np.concatenate(_axes(lies[-1:]))
            rolled = {"beside": beside, "tip roll": np.array([beside @ above])}
        return {
            "base turn": curve.base_turn,
            "turns": turns,
            "means": means,
            "frames": frames,
            "tip parts": across @ self._pointing(lies[-1:]),
            "stray": np.ones(1),
            "across": across,
            "strays": _offsets(frames, means, lies),
            **rolled,
        }

    def _pointing(self, last: FloatArray) -> FloatArray:
        """Return the direction of the last link, shape (3,), for its quaternion, shape (1, 4)."""
        axes = np.concatenate(_axes(last))
        return np.asarray(axes[0] if self.last_along is None else self.last_along @ axes)

    def link_turns(self, curve: CurveNumbers) -> tuple[FloatArray, FloatArray]:
        """Return the turns Ω of a curve over every link and the mean turns ψ from the link start, each (n, 2) [rad]."""
        joints = self.joint_arcs if self.shares else np.linspace(0.0, 1.0, self.links + 1)
        flat = [curve.turned(index) for index in range(len(self.directions))]
        at_joints = np.stack([each.heading_at(joints) for each in flat], axis=1)
        integrals = np.stack([each.heading_integral_at(joints) for each in flat], axis=1)
        return np.diff(at_joints, axis=0), np.diff(integrals, axis=0) * np.array(self.per_length) - at_joints[:-1]

    def bounds(self, lies: FloatArray, direction: FloatArray | None, turned: float, rolled: float = 0.0) -> Bounds:
        """Return bounds on the curve's turns, the last link's direction and the links' offsets from the curve, by name.

        Turns start at 0, and the fraction of the offsets that remains lies in [0, 1]. Each of the last link's two
        components perpendicular to the goal direction is at most sin(tolerance)/√2 in magnitude, so that their norm is
        at most sin(tolerance).

        Args:
            lies: unused.
            direction: direction of the last link at the goal, shape (3,), or None for no bounds on the components.
            turned: tolerance of the last link's direction [rad].
            rolled: tolerance of its roll [rad]; above a right angle, the roll is not held.
        """
        del lies
        turns = np.append(0.0, np.full(self.parts[0].count, np.inf))
        most = np.full(2, np.inf if direction is None else np.sin(turned) / np.sqrt(2.0))
        held = {f"turned {name}": pinned_bounds(turns) for name in self.directions}
        if self.up:
            beside = np.array([np.sin(rolled) if rolled < 0.5 * np.pi else np.inf])
            held["tip roll"] = (-beside, beside)
        return {**held, "tip parts": (-most, most), "stray": (np.zeros(1), np.ones(1))}

    def curve(self, arm: Arm, numbers: CurveNumbers, feed: float) -> SpaceConfiguration:
        """Return the curve of a solution of the NLP as a curve in space, in metres and world axes.

        Args:
            arm: the arm.
            numbers: the curve, with lengths relative to the arm's and axes those of its base.
            feed: displacement of the base [m].
        """
        lengths, values, shares = numbers.parts()
        left, up = numbers.base_turn
        rotation, _ = exponential(np.array([0.0, -up, left, 0.0, 0.0, 0.0]))
        return SpaceConfiguration.chain(
            arm.base + feed * arm.direction,
            arm.base_rotation @ rotation,
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


def link_quaternions(bends: FloatArray) -> FloatArray:
    """Return the quaternions of n links relative to the straight arm, shape (n, 4), for joint bends (n, 2) [rad]."""
    zero = np.zeros(len(bends))
    about_z = quaternions_of(np.column_stack((zero, zero, bends[:, 0])))
    about_y = quaternions_of(np.column_stack((zero, bends[:, 1], zero)))
    return chained_quaternions(np.stack((about_z, about_y), axis=1).reshape(-1, 4))[1::2]


def _curve_frames(base_turn: FloatArray, turns: FloatArray, means: FloatArray) -> FloatArray:
    """Return the frames of a curve at the starts of n links as quaternions, shape (n, 4).

    Args:
        base_turn: turns of the curve at its base to the left and upwards, shape (2,) [rad].
        turns: turns Ω over every link, shape (n, 2) [rad].
        means: mean turns ψ over every link from the link's start, shape (n, 2) [rad].
    """
    roll = means[:, 0] * turns[:, 1] - means[:, 1] * turns[:, 0]
    steps = np.column_stack((roll, -turns[:, 1], turns[:, 0]))[:-1]
    first = np.array([[0.0, -base_turn[1], base_turn[0]]])
    return chained_quaternions(quaternions_of(np.concatenate((first, steps))))


def _offsets(frames: FloatArray, means: FloatArray, lies: FloatArray) -> FloatArray:
    """Return the components, along each link's y and z axes, of the curve's mean direction over the link, shape (n, 2).

    Args:
        frames: quaternions of the curve's frames at the starts of the links, shape (n, 4).
        means: mean turns ψ over every link from the link's start, shape (n, 2) [rad].
        lies: quaternions of the links, shape (n, 4).
    """
    size = np.linalg.norm(means, axis=1)
    local = np.concatenate((np.cos(size)[:, None], np.sinc(size / np.pi)[:, None] * means), axis=1)
    mean = sum(local[:, [k]] * along for k, along in enumerate(_axes(frames)))
    return np.stack([np.sum(along * mean, axis=1) for along in _axes(lies)[1:]], axis=1)


def _axes(quaternions: FloatArray) -> list[FloatArray]:
    """Return the x, y and z axes turned by each of n quaternions, shape (n, 4), as three arrays of shape (n, 3)."""
    columns = ca.SX(ca.DM(quaternions.T))
    return [np.asarray(ca.evalf(axis(columns, k))).T for k in range(3)]


def _across(direction: FloatArray | None) -> FloatArray:
    """Return two unit vectors perpendicular to a direction, shape (3,), as rows (2, 3).

    For None they are perpendicular to the straight arm.
    """
    along = np.array([1.0, 0.0, 0.0]) if direction is None else direction
    return np.asarray(np.linalg.svd(along[None])[2][1:])


def _turns(bends: ca.SX) -> ca.SX:
    """Return the quaternions of Rz(a) Ry(b), shape (4, n), for symbolic joint bends (a, b), shape (2, n) [rad]."""
    half_a = bends[0, :] / 2
    half_b = bends[1, :] / 2
    return ca.vertcat(
        ca.cos(half_a) * ca.cos(half_b),
        -ca.sin(half_a) * ca.sin(half_b),
        ca.cos(half_a) * ca.sin(half_b),
        ca.sin(half_a) * ca.cos(half_b),
    )
