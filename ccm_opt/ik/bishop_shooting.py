"""Multiple shooting of a curve in space with Bishop frames, which do not twist.

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
    """Return the Hamilton products of quaternions, by columns; the second rotation is in the axes of the first."""
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
    """Return the x, y or z axis (0, 1 or 2) as turned by each rotation, shape (3, n)."""
    w, x, y, z = ca.vertsplit(quaternions)
    if number == 0:
        return ca.vertcat(w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y))
    if number == 1:
        return ca.vertcat(2 * (x * y - w * z), w**2 - x**2 + y**2 - z**2, 2 * (y * z + w * x))
    return ca.vertcat(2 * (x * z + w * y), 2 * (y * z - w * x), w**2 - x**2 - y**2 + z**2)


def chained_quaternions(turns: FloatArray) -> FloatArray:
    """Return the cumulative products of numerical quaternions, shape (n, 4), with signs chosen to be continuous."""
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
    """Links in space as quaternions, tied to frames of the curve that are shot from joint to joint.

    Every link points along the curve's mean direction over the link, up to a fraction of the offset that the links of
    the start pose have from the nearby curve. So the start pose satisfies every row. The solver may reduce the offsets
    but need not; the coordinates in which motions are planned keep their offset from the curve throughout.
    """

    directions = ("left", "up")
    start_keeps_rows = True

    @cached_property
    def lies(self) -> ca.SX:
        """Quaternions of the links, shape (4, n)."""
        return ca.SX.sym("link", 4, self.links)

    @cached_property
    def further_symbols(self) -> dict[str, ca.SX]:
        """The curve's turn at its base, Ω, ψ and starting frame of every link, and the tip's components.

        The tip parts are the components of the last link along the two axes perpendicular to the goal direction; the
        stray is the fraction of the start pose's offsets from the curve that the pose keeps.
        """
        return {
            "base turn": ca.SX.sym("base_turn", 2),
            "turns": ca.SX.sym("turn", 2, self.links),
            "means": ca.SX.sym("mean", 2, self.links),
            "frames": ca.SX.sym("frame", 4, self.links),
            "tip parts": ca.SX.sym("tip_part", 2),
            "stray": ca.SX.sym("stray"),
        }

    @cached_property
    def parameters(self) -> dict[str, ca.SX]:
        """Unit vectors perpendicular to the goal direction, (3, 2), and offsets of the start's links, (2, n)."""
        return {"across": ca.SX.sym("across", 3, 2), "strays": ca.SX.sym("offset_from_curve", 2, self.links)}

    @property
    def costs(self) -> dict[str, ca.SX]:
        """Sum of the squared angles between the links and the curve."""
        return {"stray": self.further_symbols["stray"] ** 2 * ca.sumsqr(self.parameters["strays"])}

    def link_rows(self) -> tuple[RowBlock, ...]:
        """Return the rows that define link turns, frames, link orientations, the mapping and the tip parts.

        Turns follow from the integrals of the curvatures; frames and orientations are propagated from joint to joint.
        """
        link_turns = (self._link_turns(index) for index in range(len(self.directions)))
        return (*link_turns, self._frame_gaps(), self._turning(), self._mapping(), self._tip_parts())

    def _link_turns(self, index: int) -> RowBlock:
        """Return the rows that define Ω_i = U(s_(j+1)) − U(s_j) and ψ_i = (1/h) ∫ U ds − U(s_j) of every link."""
        turned, integrals = self.joints.at_joints(self.parts[index])
        turns, means = (self.further_symbols[name][index, :].T for name in ("turns", "means"))
        gaps = ca.vertcat(
            turned[1:] - turned[:-1] - turns,
            self.links * (integrals[1:] - integrals[:-1]) - turned[:-1] - means,
        )
        kinds = ("turn of link {}", "mean turn of link {}")
        direction = self.directions[index]
        names = tuple(f"mapping: {kind.format(j + 1)}, {direction}" for kind in kinds for j in range(self.links))
        return equal_to_zero(names, gaps)

    def _frame_gaps(self) -> RowBlock:
        """Return the rows that propagate the curve's frame over each link, from one joint to the next."""
        left, up = ca.vertsplit(self.further_symbols["base turn"])
        frames, turns, means = (self.further_symbols[name] for name in ("frames", "turns", "means"))
        first = turned_by(ca.vertcat(0, -up, left))
        left, up = ca.vertsplit(turns[:, :-1])
        mean_left, mean_up = ca.vertsplit(means[:, :-1])
        carried = product(frames[:, :-1], turned_by(ca.vertcat(mean_left * up - mean_up * left, -up, left)))
        names = tuple(f"link {link + 1}: gap in {part} of its frame" for link in range(self.links) for part in "wxyz")
        return equal_to_zero(names, ca.vec(frames - ca.horzcat(first, carried)))

    def _turning(self) -> RowBlock:
        """Return the rows R_j = R_(j−1) Rz(a_j) Ry(b_j), which turn every link by the bends of its joint."""
        turns = _turns(self.bends)
        turned = product(self.lies[:, :-1], turns[:, 1:])
        names = tuple(f"link {link + 1}: gap in {part} of its turn" for link in range(self.links) for part in "wxyz")
        return equal_to_zero(names, ca.vec(self.lies - ca.horzcat(turns[:, 0], turned)))

    def _mapping(self) -> RowBlock:
        """Return the rows that align links with the curve's mean direction, up to a fraction of their start offsets."""
        means, frames, stray = (self.further_symbols[name] for name in ("means", "frames", "stray"))
        directions = mean_direction(means)
        along = sum((ca.repmat(directions[k, :], 3, 1) * axis(frames, k) for k in range(3)), ca.SX(0))
        across = ca.vertcat(*(ca.sum1(axis(self.lies, k) * along) for k in (1, 2)))
        names = tuple(f"mapping of link {link + 1}, {side}" for link in range(self.links) for side in self.directions)
        return equal_to_zero(names, ca.vec(across - stray * self.parameters["strays"]))

    def _tip_parts(self) -> RowBlock:
        """Return the rows that define the last link's components perpendicular to the goal direction.

        The bounds on these components keep the link within the tolerance.
        """
        names = ("tip: gap in its direction", "tip: gap in its direction, across")
        parts = self.parameters["across"].T @ axis(self.lies[:, self.links - 1], 0)
        return equal_to_zero(names, parts - self.further_symbols["tip parts"])

    def direction(self, lies: ca.SX) -> ca.SX:
        """Return the x axes of link quaternions."""
        return axis(lies, 0)

    def joint_axes(self) -> tuple[ca.SX, ...]:
        """Return the axes of each joint: the z axis of the previous link, and the y axis of its own link."""
        return ca.horzcat(ca.SX([0.0, 0.0, 1.0]), axis(self.lies[:, :-1], 2)), axis(self.lies, 1)

    def turns_of(self, bends: FloatArray) -> FloatArray:
        """Return the turns to the left and upwards that joint bends produce, shape (n, 2) [rad].

        A turn upwards, from x to z, is a turn about −y.
        """
        return np.asarray(bends * np.array([1.0, -1.0]))

    def lies_at(self, bends: FloatArray) -> FloatArray:
        """Return the quaternions of links with given joint bends, shape (n, 4)."""
        return link_quaternions(bends)

    def values(self, curve: CurveNumbers, lies: FloatArray, direction: FloatArray | None) -> dict[str, FloatArray]:
        """Return the values of the curve's turns and frames at the start pose, whose links keep their full offsets."""
        turns, means = self.link_turns(curve)
        frames = _curve_frames(curve.base_turn, turns, means)
        across = _across(direction)
        return {
            "base turn": curve.base_turn,
            "turns": turns,
            "means": means,
            "frames": frames,
            "tip parts": across @ _axes(lies[-1:])[0][0],
            "stray": np.ones(1),
            "across": across,
            "strays": _offsets(frames, means, lies),
        }

    def link_turns(self, curve: CurveNumbers) -> tuple[FloatArray, FloatArray]:
        """Return Ω and ψ of every link, each of shape (n, 2) [rad]."""
        joints = np.linspace(0.0, 1.0, self.links + 1)
        flat = [curve.turned(index) for index in range(len(self.directions))]
        at_joints = np.stack([each.heading_at(joints) for each in flat], axis=1)
        integrals = np.stack([each.heading_integral_at(joints) for each in flat], axis=1)
        return np.diff(at_joints, axis=0), np.diff(integrals, axis=0) * self.links - at_joints[:-1]

    def bounds(self, lies: FloatArray, direction: FloatArray | None, turned: float) -> Bounds:
        """Return the bounds of the turns, which start at 0, of the tip parts, and of the stray in [0, 1].

        The tip parts lie in a square inside the allowed cone's cross-section, so that its corners are within the
        tolerance too.
        """
        del lies
        turns = np.append(0.0, np.full(self.parts[0].count, np.inf))
        most = np.full(2, np.inf if direction is None else np.sin(turned) / np.sqrt(2.0))
        held = {f"turned {name}": pinned_bounds(turns) for name in self.directions}
        return {**held, "tip parts": (-most, most), "stray": (np.zeros(1), np.ones(1))}

    def curve(self, arm: Arm, numbers: CurveNumbers, feed: float) -> SpaceConfiguration:
        """Return the curve in space, in metres and world axes."""
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
    """Return the curve's mean direction over each link, in the frame at the link's start, shape (3, n).

    Args:
        means: ψ, shape (2, n) [rad].
    """
    # A smooth lower bound, far below any relevant angle, so that sin(x)/x has a derivative at 0.
    angle = ca.sqrt(ca.sum1(means**2) + 1e-16)
    return ca.vertcat(ca.cos(angle), ca.repmat(ca.sin(angle) / angle, 2, 1) * means)


def link_quaternions(bends: FloatArray) -> FloatArray:
    """Return the quaternions of links, shape (n, 4), for given joint bends, shape (n, 2) [rad]."""
    zero = np.zeros(len(bends))
    about_z = quaternions_of(np.column_stack((zero, zero, bends[:, 0])))
    about_y = quaternions_of(np.column_stack((zero, bends[:, 1], zero)))
    return chained_quaternions(np.stack((about_z, about_y), axis=1).reshape(-1, 4))[1::2]


def _curve_frames(base_turn: FloatArray, turns: FloatArray, means: FloatArray) -> FloatArray:
    """Return the frames at the starts of the links, shape (n, 4)."""
    roll = means[:, 0] * turns[:, 1] - means[:, 1] * turns[:, 0]
    steps = np.column_stack((roll, -turns[:, 1], turns[:, 0]))[:-1]
    first = np.array([[0.0, -base_turn[1], base_turn[0]]])
    return chained_quaternions(quaternions_of(np.concatenate((first, steps))))


def _offsets(frames: FloatArray, means: FloatArray, lies: FloatArray) -> FloatArray:
    """Return the components of the curve's mean directions across the links, shape (n, 2)."""
    size = np.linalg.norm(means, axis=1)
    local = np.concatenate((np.cos(size)[:, None], np.sinc(size / np.pi)[:, None] * means), axis=1)
    mean = sum(local[:, [k]] * along for k, along in enumerate(_axes(frames)))
    return np.stack([np.sum(along * mean, axis=1) for along in _axes(lies)[1:]], axis=1)


def _axes(quaternions: FloatArray) -> list[FloatArray]:
    """Return the x, y and z axes turned by each quaternion, each of shape (n, 3), for quaternions of shape (n, 4)."""
    columns = ca.SX(ca.DM(quaternions.T))
    return [np.asarray(ca.evalf(axis(columns, k))).T for k in range(3)]


def _across(direction: FloatArray | None) -> FloatArray:
    """Return two unit vectors perpendicular to a direction, or to the straight arm if that is None, shape (2, 3)."""
    along = np.array([1.0, 0.0, 0.0]) if direction is None else direction
    return np.asarray(np.linalg.svd(along[None])[2][1:])


def _turns(bends: ca.SX) -> ca.SX:
    """Return the quaternions, shape (4, n), of symbolic joint bends, shape (2, n) [rad]."""
    half_a = bends[0, :] / 2
    half_b = bends[1, :] / 2
    return ca.vertcat(
        ca.cos(half_a) * ca.cos(half_b),
        -ca.sin(half_a) * ca.sin(half_b),
        ca.cos(half_a) * ca.sin(half_b),
        ca.sin(half_a) * ca.cos(half_b),
    )
