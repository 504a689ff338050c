"""Multiple shooting of a curve in space with frames that do not twist.

Lengths are in units of the arm's length. The turns U_i(s) = ∫ κ_i ds and their integrals over the arc are known on
every piece of the splines, as in the plane, and tied from knot to knot. The equations of the frame, t' = κ1 n1 + κ2 n2
and n_i' = −κ_i t, have no such solution; they are shot from joint to joint. Over a link of length h, with Ω_i the turn
of the whole link and ψ_i the mean over the link of the turn from its beginning, Magnus' series gives the turn

    (ρ, −Ω2, Ω1) in the axes (t, n1, n2),  ρ = ψ1 Ω2 − ψ2 Ω1,

to the fourth order in h; where the curve is plane it is exact. Frames are unit quaternions (w, x, y, z).
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
    """Return the Hamilton's products, column by column: the second turn in the axes of the first."""
    return ca.vertcat(*_quaternion_product(ca.vertsplit(first), ca.vertsplit(second)))


def _quaternion_product(first: Iterable[Any], second: Iterable[Any]) -> tuple[Any, Any, Any, Any]:
    """Return the parts of Hamilton's product, of symbols or numbers."""
    w, x, y, z = first
    a, b, c, d = second
    return (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )


def turned_by(vectors: ca.SX) -> ca.SX:
    """Return the turns by rotation vectors, shape (3, n) [rad]."""
    angle = ca.sqrt(ca.sum1(vectors**2) + 1e-16)  # smooth at no turn, and otherwise the same but for rounding
    share = ca.sin(angle / 2) / angle
    return ca.vertcat(ca.cos(angle / 2), ca.repmat(share, 3, 1) * vectors)


def axis(quaternions: ca.SX, number: int) -> ca.SX:
    """Return the x, y or z axis (0, 1 or 2) after each turn, a column of its matrix, shape (3, n)."""
    w, x, y, z = ca.vertsplit(quaternions)
    if number == 0:
        return ca.vertcat(w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y))
    if number == 1:
        return ca.vertcat(2 * (x * y - w * z), w**2 - x**2 + y**2 - z**2, 2 * (y * z + w * x))
    return ca.vertcat(2 * (x * z + w * y), 2 * (y * z - w * x), w**2 - x**2 - y**2 + z**2)


def chained_quaternions(turns: FloatArray) -> FloatArray:
    """Return the products of turns one after the other, shape (n, 4), as numbers; continuous in sign."""
    chained = np.empty_like(turns)
    latest = np.array([1.0, 0.0, 0.0, 0.0])
    for step, turn in enumerate(turns):
        latest = np.array(_quaternion_product(latest, turn))
        chained[step] = latest
    return chained


def quaternions_of(vectors: FloatArray) -> FloatArray:
    """Return the turns by rotation vectors as numbers, shape (n, 3) to (n, 4)."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.concatenate((np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors), axis=1)


class BishopFrames(CurveFrames):
    """Links in space: quaternions, tied to frames of the curve that are shot from joint to joint.

    Every link points as the curve does in the mean over the link, but for a share of the offset that the links of the
    start have from the curve near it. So the start keeps every row. The pose may lose the offsets, but need not: so it
    is with the coordinates of motions, whose offset from the curve stays all the way.
    """

    directions = ("left", "up")
    start_keeps_rows = True

    @cached_property
    def lies(self) -> ca.SX:
        """Quaternions of the links, shape (4, n)."""
        return ca.SX.sym("link", 4, self.links)

    @cached_property
    def further_symbols(self) -> dict[str, ca.SX]:
        """The curve's turn at its base, Ω and ψ of every link, its frames at their beginnings, and the tip's parts.

        The tip's parts are what the last link has of the two axes across the goal's direction, and what strays is the
        share of the start's offsets that the pose keeps.
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
        """Unit vectors across the goal's direction, (3, 2), and what links of the start have across a curve, (2, n)."""
        return {"across": ca.SX.sym("across", 3, 2), "strays": ca.SX.sym("offset_from_curve", 2, self.links)}

    @property
    def costs(self) -> dict[str, ca.SX]:
        """The squared angles by which links point elsewhere than the curve."""
        return {"stray": self.further_symbols["stray"] ** 2 * ca.sumsqr(self.parameters["strays"])}

    def link_rows(self) -> tuple[RowBlock, ...]:
        """Turns of the links from the curvatures' integrals, frames and links from joint to joint, and the tip's."""
        link_turns = (self._link_turns(index) for index in range(len(self.directions)))
        return (*link_turns, self._frame_gaps(), self._turning(), self._mapping(), self._tip_parts())

    def _link_turns(self, index: int) -> RowBlock:
        """Return the Ω_i = U(s_(j+1)) − U(s_j) and ψ_i = (1/h) ∫ U ds − U(s_j) of every link."""
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
        """Return the frame at a joint is that at the joint before, carried over the link between."""
        left, up = ca.vertsplit(self.further_symbols["base turn"])
        frames, turns, means = (self.further_symbols[name] for name in ("frames", "turns", "means"))
        first = turned_by(ca.vertcat(0, -up, left))
        left, up = ca.vertsplit(turns[:, :-1])
        mean_left, mean_up = ca.vertsplit(means[:, :-1])
        carried = product(frames[:, :-1], turned_by(ca.vertcat(mean_left * up - mean_up * left, -up, left)))
        names = tuple(f"link {link + 1}: gap in {part} of its frame" for link in range(self.links) for part in "wxyz")
        return equal_to_zero(names, ca.vec(frames - ca.horzcat(first, carried)))

    def _turning(self) -> RowBlock:
        """Return the r_j = R_(j−1) Rz(a_j) Ry(b_j): the links turn by the bends of their joints."""
        turns = _turns(self.bends)
        turned = product(self.lies[:, :-1], turns[:, 1:])
        names = tuple(f"link {link + 1}: gap in {part} of its turn" for link in range(self.links) for part in "wxyz")
        return equal_to_zero(names, ca.vec(self.lies - ca.horzcat(turns[:, 0], turned)))

    def _mapping(self) -> RowBlock:
        """Return every link points as the curve does in the mean over the link, but for a share of its offset."""
        means, frames, stray = (self.further_symbols[name] for name in ("means", "frames", "stray"))
        directions = mean_direction(means)
        along = sum((ca.repmat(directions[k, :], 3, 1) * axis(frames, k) for k in range(3)), ca.SX(0))
        across = ca.vertcat(*(ca.sum1(axis(self.lies, k) * along) for k in (1, 2)))
        names = tuple(f"mapping of link {link + 1}, {side}" for link in range(self.links) for side in self.directions)
        return equal_to_zero(names, ca.vec(across - stray * self.parameters["strays"]))

    def _tip_parts(self) -> RowBlock:
        """Return what the last link has of the two axes across the goal's direction.

        Bounds keep it within the tolerance.
        """
        names = ("tip: gap in its direction", "tip: gap in its direction, across")
        parts = self.parameters["across"].T @ axis(self.lies[:, self.links - 1], 0)
        return equal_to_zero(names, parts - self.further_symbols["tip parts"])

    def direction(self, lies: ca.SX) -> ca.SX:
        """Return the their x axes."""
        return axis(lies, 0)

    def joint_axes(self) -> tuple[ca.SX, ...]:
        """Return the z axis of the link before, and y of its own."""
        return ca.horzcat(ca.SX([0.0, 0.0, 1.0]), axis(self.lies[:, :-1], 2)), axis(self.lies, 1)

    def turns_of(self, bends: FloatArray) -> FloatArray:
        """Return a turn upwards, from x to z, is one about −y."""
        return np.asarray(bends * np.array([1.0, -1.0]))

    def lies_at(self, bends: FloatArray) -> FloatArray:
        """Return the quaternions of links turned by bends, shape (n, 4)."""
        return link_quaternions(bends)

    def values(self, curve: CurveNumbers, lies: FloatArray, direction: FloatArray | None) -> dict[str, FloatArray]:
        """Return the turns and frames of the curve; the start keeps all of its offsets from it."""
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
        """Return the Ω and ψ of every link, each of shape (n, 2) [rad]."""
        joints = np.linspace(0.0, 1.0, self.links + 1)
        flat = [curve.turned(index) for index in range(len(self.directions))]
        at_joints = np.stack([each.heading_at(joints) for each in flat], axis=1)
        integrals = np.stack([each.heading_integral_at(joints) for each in flat], axis=1)
        return np.diff(at_joints, axis=0), np.diff(integrals, axis=0) * self.links - at_joints[:-1]

    def bounds(self, lies: FloatArray, direction: FloatArray | None, turned: float) -> Bounds:
        """Turns begin at 0, and the tip's parts lie in the square inside the section of the cone that is allowed.

        Its corners are within the tolerance too.
        """
        del lies
        turns = np.append(0.0, np.full(self.parts[0].count, np.inf))
        most = np.full(2, np.inf if direction is None else np.sin(turned) / np.sqrt(2.0))
        held = {f"turned {name}": pinned_bounds(turns) for name in self.directions}
        return {**held, "tip parts": (-most, most), "stray": (np.zeros(1), np.ones(1))}

    def curve(self, arm: Arm, numbers: CurveNumbers, feed: float) -> SpaceConfiguration:
        """Return the curve in space."""
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
    """Return the mean direction of the curve over links, in the axes of the frames at their beginnings, shape (3, n).

    Args:
        means: ψ, shape (2, n) [rad].
    """
    # A smooth least length far below what matters, so that sin(x)/x has a derivative at 0.
    angle = ca.sqrt(ca.sum1(means**2) + 1e-16)
    return ca.vertcat(ca.cos(angle), ca.repmat(ca.sin(angle) / angle, 2, 1) * means)


def link_quaternions(bends: FloatArray) -> FloatArray:
    """Return the quaternions of links turned by bends, shape (n, 2) to (n, 4)."""
    zero = np.zeros(len(bends))
    about_z = quaternions_of(np.column_stack((zero, zero, bends[:, 0])))
    about_y = quaternions_of(np.column_stack((zero, bends[:, 1], zero)))
    return chained_quaternions(np.stack((about_z, about_y), axis=1).reshape(-1, 4))[1::2]


def _curve_frames(base_turn: FloatArray, turns: FloatArray, means: FloatArray) -> FloatArray:
    """Return the frames at the beginnings of the links, shape (n, 4)."""
    roll = means[:, 0] * turns[:, 1] - means[:, 1] * turns[:, 0]
    steps = np.column_stack((roll, -turns[:, 1], turns[:, 0]))[:-1]
    first = np.array([[0.0, -base_turn[1], base_turn[0]]])
    return chained_quaternions(quaternions_of(np.concatenate((first, steps))))


def _offsets(frames: FloatArray, means: FloatArray, lies: FloatArray) -> FloatArray:
    """Return what links have of the mean directions of a curve across themselves, shape (n, 2)."""
    size = np.linalg.norm(means, axis=1)
    local = np.concatenate((np.cos(size)[:, None], np.sinc(size / np.pi)[:, None] * means), axis=1)
    mean = sum(local[:, [k]] * along for k, along in enumerate(_axes(frames)))
    return np.stack([np.sum(along * mean, axis=1) for along in _axes(lies)[1:]], axis=1)


def _axes(quaternions: FloatArray) -> list[FloatArray]:
    """Return the x, y and z axes after each turn, shape (n, 4) to (n, 3) each, as numbers."""
    columns = ca.SX(ca.DM(quaternions.T))
    return [np.asarray(ca.evalf(axis(columns, k))).T for k in range(3)]


def _across(direction: FloatArray | None) -> FloatArray:
    """Return two unit vectors across a direction, that of the straight arm where there is none, shape (2, 3)."""
    along = np.array([1.0, 0.0, 0.0]) if direction is None else direction
    return np.asarray(np.linalg.svd(along[None])[2][1:])


def _turns(bends: ca.SX) -> ca.SX:
    """Return the turns by the bends of joints, shape (2, n) to (4, n)."""
    half_a = bends[0, :] / 2
    half_b = bends[1, :] / 2
    return ca.vertcat(
        ca.cos(half_a) * ca.cos(half_b),
        -ca.sin(half_a) * ca.sin(half_b),
        ca.cos(half_a) * ca.sin(half_b),
        ca.sin(half_a) * ca.cos(half_b),
    )
