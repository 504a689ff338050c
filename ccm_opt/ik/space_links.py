"""Links in space as unit quaternions that the bends of their joints turn, symbols of the goal-pose NLP.

Lengths are in units of the arm's length. Quaternions are (w, x, y, z).
"""

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.link_frames import LinkFrames
from ccm_opt.ik.row_program import Bounds, RowBlock, equal_to_zero


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


def chained_quaternions(turns: FloatArray, base: FloatArray | None = None) -> FloatArray:
    """Return the cumulative products of numerical quaternions, from the first to each, both of shape (n, 4).

    The products are not normalised to a sign (q and −q are the same rotation), so they change continuously with the
    arguments.

    Args:
        turns: the quaternions.
        base: quaternion before the first, shape (4,); None for none.
    """
    chained = np.empty_like(turns)
    latest = np.array([1.0, 0.0, 0.0, 0.0]) if base is None else base
    for step, turn in enumerate(turns):
        latest = np.array(_quaternion_product(latest, turn))
        chained[step] = latest
    return chained


def quaternions_of(vectors: FloatArray) -> FloatArray:
    """Return the quaternions, shape (n, 4), of numerical rotation vectors, shape (n, 3) [rad]."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.concatenate((np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors), axis=1)


@dataclass(frozen=True, eq=False)
class SpaceLinks(LinkFrames):
    """Links in space as unit quaternions, with the direction and the roll of the last one."""

    directions = ("left", "up")
    start_keeps_rows = True

    @cached_property
    def _base(self) -> tuple[ca.SX, ca.SX]:
        """Position of the first joint, shape (3, 1), and the quaternion of the base, (4, 1), on the axes that carry it.

        The axis nearest to the base moves it first.
        """
        place, turned = ca.SX.zeros(3), ca.SX([1.0, 0.0, 0.0, 0.0])
        for number, (revolute, *axis_row) in reversed(list(enumerate(self.carrier))):
            along, point = ca.DM(axis_row[:3]), ca.DM(axis_row[3:])
            if not revolute:
                place += along * self.feed[number]
                continue
            turn = ca.vertcat(ca.cos(self.feed[number] / 2), ca.sin(self.feed[number] / 2) * along)
            off = place - point
            place = point + sum((axis(turn, k) * off[k] for k in range(3)), ca.SX(0))
            turned = product(turn, turned)
        return place, turned

    def base_place(self) -> ca.SX:
        """Return the position of the first joint, shape (3, 1)."""
        return self._base[0] if self.carrier else super().base_place()

    def from_base(self, turn: ca.SX) -> ca.SX:
        """Return the quaternion, shape (4, 1), of a turn relative to the base."""
        return product(self._base[1], turn) if self.carrier else turn

    def base_turn(self, feed: FloatArray) -> FloatArray:
        """Return the quaternion of the base, shape (4,), at positions of the axes that carry it, shape (k,)."""
        turns = [value * np.array(row[1:4]) for value, row in zip(feed, self.carrier, strict=False) if row[0]]
        return np.asarray(chained_quaternions(quaternions_of(np.array(turns)))[-1] if turns else np.eye(4)[0])

    @cached_property
    def lies(self) -> ca.SX:
        """Unit quaternions that turn the axes of the straight arm into those of each of the n links, shape (4, n)."""
        return ca.SX.sym("link", 4, self.links)

    @cached_property
    def tip_symbols(self) -> dict[str, ca.SX]:
        """Symbols for the direction of the tip by name.

        They are the components of the last link along two axes perpendicular to the goal direction ("tip parts") and,
        for a goal with a roll, the component of its up axis perpendicular to the goal's direction and to where up is
        ("tip roll").
        """
        rolled = {"tip roll": ca.SX.sym("tip_roll")} if self.up else {}
        return {"tip parts": ca.SX.sym("tip_part", 2), **rolled}

    @cached_property
    def tip_parameters(self) -> dict[str, ca.SX]:
        """Two unit vectors "across" the goal direction, shape (3, 2), and for a goal with a roll "beside", by name.

        The latter is the unit vector perpendicular to the goal's direction and to where up is.
        """
        return {"across": ca.SX.sym("across", 3, 2)} | ({"beside": ca.SX.sym("beside", 3)} if self.up else {})

    def turning_rows(self) -> RowBlock:
        """Return the NLP constraints R_j = R_(j−1) T_j, which turn every link by the bends of its joint."""
        turns = self.joint_turns()
        turned = product(self.lies[:, :-1], turns[:, 1:])
        names = tuple(f"link {link + 1}: gap in {part} of its turn" for link in range(self.links) for part in "wxyz")
        return equal_to_zero(names, ca.vec(self.lies - ca.horzcat(self.from_base(turns[:, 0]), turned)))

    @property
    def lies_before(self) -> ca.SX:
        """Quaternions of the links before the joints, of the base first, shape (4, n)."""
        return ca.horzcat(self.from_base(ca.SX([1.0, 0.0, 0.0, 0.0])), self.lies[:, :-1])

    @abstractmethod
    def joint_turns(self) -> ca.SX:
        """Return the quaternions T by which the joints turn their links, shape (4, n)."""

    def tip_rows(self) -> RowBlock:
        """Return the NLP constraints that define the components of the last link perpendicular to the goal direction.

        For a goal with a roll, another one defines the component of its up axis. Bounds on these components keep the
        link within the tolerance of the goal.
        """
        names = ("tip: gap in its direction", "tip: gap in its direction, across")
        parts = self.tip_parameters["across"].T @ self.direction(self.lies)[:, self.links - 1]
        gaps = parts - self.tip_symbols["tip parts"]
        if not self.up:
            return equal_to_zero(names, gaps)
        axes = self.link_axes(self.lies[:, self.links - 1])
        above = sum((number * each for number, each in zip(self.up, axes, strict=True)), ca.SX(0))
        rolled = ca.dot(self.tip_parameters["beside"], above) - self.tip_symbols["tip roll"]
        return equal_to_zero((*names, "tip: gap in its roll"), ca.vertcat(gaps, rolled))

    def link_axes(self, lies: ca.SX) -> tuple[ca.SX, ...]:
        """Return the axes of links, each of shape (3, e), from their quaternions, shape (4, e)."""
        return axis(lies, 0), axis(lies, 1), axis(lies, 2)

    def tip_values(
        self, lies: FloatArray, direction: FloatArray | None, beside: FloatArray | None
    ) -> dict[str, FloatArray]:
        """Return the values at a pose of ``tip_symbols`` and ``tip_parameters``, by name.

        Args:
            lies: quaternions of the links, shape (n, 4).
            direction: direction of the last link at the goal, shape (3,), or None.
            beside: unit vector perpendicular to the direction and to where up is at the goal, shape (3,), or None.
        """
        across = _across(direction)
        rolled = {}
        if self.up and beside is not None:
            above = np.array(self.up) @ np.concatenate(quaternion_axes(lies[-1:]))
            rolled = {"beside": beside, "tip roll": np.array([beside @ above])}
        return {"across": across, "tip parts": across @ self._pointing(lies[-1:]), **rolled}

    def _pointing(self, last: FloatArray) -> FloatArray:
        """Return the direction of the last link, shape (3,), for its quaternion, shape (1, 4)."""
        axes = np.concatenate(quaternion_axes(last))
        return np.asarray(axes[0] if self.last_along is None else self.last_along @ axes)

    def tip_bounds(self, direction: FloatArray | None, turned: float, rolled: float) -> Bounds:
        """Return the bounds that hold the direction and the roll of the last link at the goal, by name.

        Each of the last link's two components perpendicular to the goal direction is at most sin(tolerance)/√2 in
        magnitude, so that their norm is at most sin(tolerance).

        Args:
            direction: direction of the last link at the goal, shape (3,), or None for no bounds on the components.
            turned: tolerance of the last link's direction [rad].
            rolled: tolerance of its roll [rad]; above a right angle, the roll is not held.
        """
        most = np.full(2, np.inf if direction is None else np.sin(turned) / np.sqrt(2.0))
        held: dict[str, tuple[FloatArray, FloatArray]] = {"tip parts": (-most, most)}
        if self.up:
            beside = np.array([np.sin(rolled) if rolled < 0.5 * np.pi else np.inf])
            held["tip roll"] = (-beside, beside)
        return held


def quaternion_axes(quaternions: FloatArray) -> list[FloatArray]:
    """Return the x, y and z axes turned by each of n quaternions, shape (n, 4), as three arrays of shape (n, 3)."""
    columns = ca.SX(ca.DM(quaternions.T))
    return [np.asarray(ca.evalf(axis(columns, k))).T for k in range(3)]


def _across(direction: FloatArray | None) -> FloatArray:
    """Return two unit vectors perpendicular to a direction, shape (3,), as rows (2, 3).

    For None they are perpendicular to the straight arm.
    """
    along = np.array([1.0, 0.0, 0.0]) if direction is None else direction
    return np.asarray(np.linalg.svd(along[None])[2][1:])
