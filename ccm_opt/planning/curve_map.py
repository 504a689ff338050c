"""The map from the curvature of a curve to configurations of the arm; the curve is fixed in space while the arm is fed.

The curve's curvature about each of two axes is linear between its values at evenly spaced knots. A joint at arc length
σ bends by (F(σ + l) − F(σ)) / l − (F(σ) − F(σ − l')) / l', where F is the second integral of the curvature: by the
change of the curve's mean heading from the link before the joint, of length l', to the link after it. On a feed axis, σ
is measured from the end of the guide tube, so that an arm that is only fed follows its own shape. Joints inside the
tube and a little beyond its end are straight.

Unknowns v: without a guide tube the two rotations of the first joint, then the curvatures about the first and about the
second axis, then the positions of the axes that carry the base, then the weights of blends. All but the weights are
scaled so that a unit of each has about the same effect on the bends.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.native import NativeCall
from ccm_opt.core.polyline import points_at
from ccm_opt.planning.pose import CurveUnknowns, Pose
from ccm_opt.planning.sampled_motions import Emergence
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import bend_shares, free_before

KNOTS = 11
SETTLING = 1e-2
"""Weight of differences of unknowns from knot to knot in a fit, just large enough to make the solution unique."""
SMOOTHNESS = 2.0
"""Weight of differences of unknowns from knot to knot in the fit of a pose whose remaining bends are blended in.
Measured: among bays of a wing box, blades and pipes, motions to such an end are a twentieth shorter than with a small
weight, with larger gaps."""
FEED_A_SPAN = 0.12
"""Maximum change of feed over a span of a path, over a piece of an edge, and between keyframes of an arm that follows
its tip, in nominal links. It is less than half of the length beyond the guide tube on which joints are straight, so
that no joint bends on a span on which it is inside the tube. Within a piece bends are linear and deviate from those of
the curve; measured in pipes, with pieces of whole links, an arm of 1 m deviates by up to 27 mm."""


_LEAST_EFFECT = 0.1
"""Least effect of a knot's curvature on the bends with which it is scaled, relative to the greatest one or that on a
link. Heuristic: enough for steps to be well conditioned where joints are locked, or stay in the guide tube."""


@dataclass(frozen=True, eq=False)
class CurveMap(CurveUnknowns):
    """The map from unknowns v, shape (p,), to configurations q, shape (c,).

    Attributes:
        spacing: spacing of the knots [m].
        knots: number of knots, for each of the two axes.
        scale: base rotations [rad], curvatures [1/m] and positions of base axes [m, rad] per unit of the unknowns
            except the b blend weights, shape (p − b,).
        offset: bends added to those of the curve, at the arc lengths ``offset_at``, shape (m, 2) [rad].
        offset_at: arc lengths of ``offset`` and ``blends``, increasing, shape (m,) [m].
        blends: bends that are added with the last b unknowns as weights, at the arc lengths ``offset_at``, shape
            (b, m, 2) [rad].
        full_from: arc length of the first bent joint of the offset and of each blend, shape (1 + b,) [m], between which
            and the guide tube their bends grow from zero; None for the first nonzero bends.
    """

    spacing: float
    knots: int
    scale: FloatArray
    offset: FloatArray
    offset_at: FloatArray
    blends: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 2)))
    full_from: FloatArray | None = None

    @classmethod
    def through(cls, arm: Arm, q: FloatArray, knots: int = KNOTS) -> tuple["CurveMap", FloatArray]:
        """Return a map that reproduces a configuration exactly, and the unknowns of that configuration, shape (p,).

        Args:
            arm: the arm.
            q: the configuration, shape (c,) [rad, m].
            knots: number of knots; without a guide tube at most one less than the number of links, and at least 3.
        """
        length = arm.length
        if arm.feed is None:
            knots = max(3, min(knots, arm.links - 1))
        else:
            # What never leaves the guide tube has no curve.
            length = max(min(length, length + arm.feed.high - arm.hole), arm.link_length)
        plain = cls(arm, length / (knots - 1), knots, np.ones(0), np.zeros((2, 2)), np.array([0.0, 1.0]))
        norms = np.linalg.norm(plain._shapes(plain._places_at_full_feed), axis=0)
        norms = np.maximum(norms, _LEAST_EFFECT * max(float(np.max(norms)), arm.link_length))
        of_base = np.ones(0 if arm.feed else 2)
        scale = np.concatenate((of_base, 1.0 / norms, 1.0 / norms, plain.axis_scale))
        plain = replace(plain, scale=scale)
        v = plain.fitted(q)
        return _through(plain, v, q), v

    @property
    def dimension(self) -> int:
        """Number p of unknowns v."""
        return len(self.scale) + len(self.blends)

    def configuration(self, v: FloatArray) -> FloatArray:
        """Return the configuration q, shape (c,) [rad, m], of unknowns v, shape (p,)."""
        return np.asarray(self.configurations(v[None])[0])

    def configurations(self, v: FloatArray) -> FloatArray:
        """Return the configurations, shape (m, c) [rad, m], of several vectors of unknowns, shape (m, p)."""
        feeds = self._feeds(v)
        places = self._joint_arc_lengths(feeds)
        turns = self._turns(v, places, self._shapes(places))
        return np.concatenate((turns.reshape(len(v), 2 * self.arm.links), feeds), axis=1)

    def pose(self, v: FloatArray) -> Pose:
        """Return the pose of unknowns of shape (p,)."""
        return self.poses(v[None])[0]

    def poses(self, unknowns: FloatArray) -> tuple[Pose, ...]:
        """Return the poses of several vectors of unknowns, shape (m, p)."""
        if self.affine:
            configurations = self.configurations(unknowns)
            slopes = self.drive_rows
        else:
            configurations, slopes = self.configurations_and_slopes(unknowns)
        return poses_with(self.arm, unknowns, configurations, slopes)

    def along(self, spline: BSpline) -> BSpline:
        """Return the spline of configurations, clipped to the limits, along a spline in the unknowns.

        For a fed arm, its control points are the configurations at the Greville abscissae of refined knots, which are
        so dense that a joint which bends on one span is outside the guide tube on all spans that the same control
        points influence.
        """
        limits = (self.arm.lower_limits, self.arm.upper_limits)
        k = spline.k
        if self.affine:
            return BSpline(spline.t, np.clip(self.configurations(spline.c), *limits), k)
        ends = spline.t[k:-k]
        fed = np.asarray(spline(ends))[:, self.feed_column] * self.scale[self.feed_column]
        most = FEED_A_SPAN * self.nominal_length
        parts = np.maximum(np.ceil(np.abs(np.diff(fed)) / most), 1.0).astype(np.intp)
        inner = np.concatenate([np.linspace(ends[i], ends[i + 1], part + 1)[1:] for i, part in enumerate(parts)])
        knots = np.concatenate((np.zeros(k + 1), inner, np.ones(k)))
        places = np.mean([knots[1 + i : len(knots) - k + i] for i in range(k)], axis=0)
        return BSpline(knots, np.clip(self.configurations(np.asarray(spline(places))), *limits), k)

    def slopes(self, v: FloatArray) -> FloatArray:
        """Return the derivatives of the configuration with respect to the unknowns, shape (c, p)."""
        _, slopes = self.configurations_and_slopes(v[None])
        return np.asarray(slopes[0])

    def configurations_and_slopes(self, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return configurations and their derivatives, for several vectors of unknowns, shape (m, p).

        Returns:
            Shapes (m, c) [rad, m] and (m, c, p).
        """
        m = len(v)
        n = self.arm.links
        k = self.knots
        fed = self.arm.feed is not None
        feeds = self._feeds(v)
        places = self._joint_arc_lengths(feeds)
        if fed:
            # With the feed, joints slide along the curve: their derivative is a central difference.
            step = 1e-6 * self.arm.length
            places = np.concatenate((places, places + step, places - step))
            v = np.tile(v, (3, 1))
        shapes = self._shapes(places)
        turns = self._turns(v, places, shapes).reshape(len(v), 2 * n)
        slopes = np.zeros((m, len(self.arm.coordinates), self.dimension))
        turned = self._base_turns
        if turned:
            slopes[:, [0, 1], [0, 1]] = self._bent_by_base
        for axis in (0, 1):
            columns = slice(turned + axis * k, turned + (axis + 1) * k)
            slopes[:, axis : 2 * n : 2, columns] = shapes[:m] * self.scale[columns]
        axes = np.arange(self.dimension)[self.axis_columns]
        slopes[:, self.arm.coordinates.base, axes] = np.diag(self.scale[axes])
        if fed:
            change = (turns[m : 2 * m] - turns[2 * m :]) / (2.0 * step)
            slopes[:, : 2 * n, axes] = change[..., None] * self.scale[axes]
        for number in range(1, len(self.blends) + 1):
            slopes[:, : 2 * n, len(self.scale) + number - 1] = self._gated(number, places[:m]).reshape(m, 2 * n)
        if self._held is not None:
            slopes[:, : 2 * n][:, self._held.ravel()] = 0.0
        return np.concatenate((turns[:m], feeds), axis=1), slopes

    def pieces(self, before: FloatArray, after: FloatArray) -> list[FloatArray]:
        """Return the unknowns, each (p,), at which an edge is divided into pieces, including both ends of the edge.

        Within a piece no joint inside the guide tube bends, and bends are nearly linear. The edge of an arm without a
        guide tube is not divided.

        Args:
            before: unknowns at the first end, shape (p,).
            after: unknowns at the last end, shape (p,).
        """
        if self.affine:
            return [before, after]
        scale = float(self.scale[self.feed_column])
        start = float(before[self.feed_column]) * scale
        way = float(after[self.feed_column]) * scale - start
        share = 0.0
        places = [before]
        while share < 1.0:
            to_stop = feed_to_next_stop(self, start + share * way, forward=way > 0.0)
            room = min(to_stop, FEED_A_SPAN * self.nominal_length)
            share = 1.0 if abs(way) * (1.0 - share) <= room else share + room / abs(way)
            places.append(before + share * (after - before))
        return places

    def in_pieces(self, unknowns: FloatArray) -> FloatArray:
        """Return the unknowns (K, p) of a motion with all edges divided by ``pieces``, shape (m, p)."""
        return np.stack([unknowns[0], *(v for edge in pairwise(unknowns) for v in self.pieces(*edge)[1:])])

    def fitted(self, q: FloatArray, smoothness: float = SETTLING) -> FloatArray:
        """Return the unknowns fitted to a configuration by least squares, with zero blend weights, shape (p,).

        Args:
            q: configuration, shape (c,) [rad, m].
            smoothness: weight of differences of unknowns from knot to knot, relative to errors of the bends.
        """
        n = self.arm.links
        v = np.zeros(self.dimension)
        v[self.axis_columns] = q[2 * n :] / self.scale[self.axis_columns]
        places = self.places(float(np.sum(q[2 * n :])))
        wanted = q[: 2 * n].reshape(n, 2) - self.offsets(places, v)
        shapes = self._shapes(places)
        turned = self._base_turns
        k = self.knots
        smooth = smoothness * np.diff(np.eye(k), axis=0)
        for axis in range(2):
            columns = slice(turned + axis * k, turned + (axis + 1) * k)
            rows = shapes * self.scale[columns]
            if turned:
                rows = np.column_stack((np.eye(n)[:, 0], rows))
            if self._held is not None:
                rows = rows * ~self._held[:, axis, None]
            tie = np.column_stack((np.zeros((k - 1, rows.shape[1] - k)), smooth))
            matrix = np.vstack((rows, tie))
            target = np.concatenate((wanted[:, axis], np.zeros(k - 1)))
            found = np.linalg.lstsq(matrix, target, rcond=1e-10)[0]
            v[columns] = found[rows.shape[1] - k :]
            if turned:
                v[axis] = found[0]
        return v

    def blended_to(self, q: FloatArray) -> tuple["CurveMap", FloatArray]:
        """Return the map with one more blend, and the unknowns (p + 1,) of another configuration in the new map.

        With a weight of 1 for the new blend and 0 for the others, the map reproduces that configuration exactly.

        Args:
            q: the other configuration, shape (c,) [rad, m].
        """
        v = self.fitted(q, SMOOTHNESS)
        left = (q - self.configuration(v))[: 2 * self.arm.links].reshape(-1, 2)
        places = self.places(float(np.sum(q[2 * self.arm.links :])))
        grid = places if self.affine else np.union1d(self.offset_at, places)
        last = points_at(left, places, grid) * (grid <= places[-1])[:, None]
        both = self._on_grid(grid, last[None], np.append(self._full_from, _first_bent(places, left)))
        return both, np.append(v, 1.0)

    def with_blends_of(
        self, other: "CurveMap", own: FloatArray, others: FloatArray
    ) -> tuple["CurveMap", FloatArray, FloatArray]:
        """Return the map with the b' blends of another map appended, and unknowns of both in the new one.

        Args:
            other: map of the same arm with the same knots; both maps have a zero offset.
            own: unknowns of this map, shape (m, p).
            others: unknowns of the other map, shape (k, p').

        Returns:
            The map, ``own`` in it, shape (m, p + b'), and ``others`` in it, shape (k, p + b').
        """
        grid = np.union1d(self.offset_at, other.offset_at)
        appended = np.stack([points_at(blend, other.offset_at, grid) for blend in other.blends])
        both = self._on_grid(grid, appended, np.concatenate((self._full_from, other._full_from[1:])))  # noqa: SLF001 - its own kind
        shared = len(self.scale)
        after = np.pad(own, ((0, 0), (0, len(other.blends))))
        before = np.insert(others, np.full(len(self.blends), shared), 0.0, axis=1)
        return both, after, before

    def _on_grid(self, grid: FloatArray, appended: FloatArray, full_from: FloatArray) -> "CurveMap":
        """Return the map with offset and blends at other arc lengths that include the present ones, and more blends.

        Args:
            grid: arc lengths, increasing, shape (m,) [m].
            appended: bends of the further blends at these arc lengths, shape (k, m, 2) [rad].
            full_from: arc length of the first bent joint of the offset and of all blends, shape (1 + b + k,) [m].
        """
        offset, *blends = (points_at(values, self.offset_at, grid) for values in (self.offset, *self.blends))
        return replace(self, offset=offset, offset_at=grid, blends=np.array([*blends, *appended]), full_from=full_from)

    @cached_property
    def _held(self) -> BoolArray | None:
        """Mask of the bends that are locked, shape (links, 2); None if no joint has just one of its two locked."""
        locked = self.arm.bend_limits.reshape(-1, 2) == 0.0
        return locked if np.any(locked[:, 0] != locked[:, 1]) else None

    @property
    def emergence(self) -> Emergence | None:
        """How bends grow beyond the guide tube, if they are linear in the unknowns otherwise; None if they are not."""
        return None

    @property
    def bending_places(self) -> FloatArray:
        """Arc length that has to be out of the guide tube for each joint to bend, shape (links,) [m]."""
        return self.arm.bending_places

    @property
    def _base_turns(self) -> int:
        """Number of unknowns of the first joint's rotation, which precede those of the curve: 2, or 0 if fed."""
        return 0 if self.arm.feed else 2

    @property
    def _bent_by_base(self) -> FloatArray:
        """Bend of the base joint per unit of each of its two unknowns, shape (2,) [rad]; zeros if it is clamped."""
        return np.zeros(2) if self.arm.clamped_joints else self.scale[:2]

    def unbent(self, v: FloatArray) -> FloatArray:
        """Return unknowns (p,) with zero curvature and all others unchanged."""
        straight = v.copy()
        turned = self._base_turns
        straight[turned : turned + 2 * self.knots] = 0.0
        return straight

    @property
    def axis_columns(self) -> slice:
        """Slice of the unknowns of the k axes that carry the base."""
        return slice(self.feed_column, len(self.scale))

    @property
    def feed_column(self) -> int:
        """Index of the unknown of the feed, or of the first axis that carries the base."""
        return len(self.scale) - len(self.arm.base_axes)

    @property
    def axis_scale(self) -> FloatArray:
        """Change of the position of each axis that carries the base per unit of its unknown, shape (k,) [m, rad]."""
        return np.array([self.nominal_length if axis.unit == "m" else 1.0 for axis in self.arm.base_axes])

    @property
    def curvature_rows(self) -> FloatArray:
        """Matrix from the unknowns to the curvatures at the knots, first axis first, shape (2 knots, p) [1/m]."""
        turned = self._base_turns
        count = 2 * self.knots
        rows = np.zeros((count, self.dimension))
        rows[:, turned : turned + count] = np.diag(self.scale[turned : turned + count])
        return rows

    def metric(self, pose: Pose) -> FloatArray:
        """Return M, shape (p, p), with δᵀ M δ = squared rotations plus weighted squared displacements of links for δ.

        The squared displacements, in nominal links, have a weight of 0.01, and a small ridge is added.
        """
        p = len(pose.v)
        turning = pose.turning.reshape(-1, p)
        moving = pose.moving.reshape(-1, p) / self.nominal_length
        metric = turning.T @ turning + 0.01 * moving.T @ moving
        return np.asarray(metric + 1e-9 * np.trace(metric) * np.eye(p))

    def drawn_axes(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Return the unknowns of random positions of the k axes that carry the base, shape (count, k)."""
        base = self.arm.coordinates.base
        low, high = self.arm.lower_limits[base], self.arm.upper_limits[base]
        return np.asarray(rng.uniform(low, high, (count, len(low))) / self.scale[self.axis_columns])

    @property
    def affine(self) -> bool:
        """Whether configurations are affine functions of the unknowns: not on a feed axis, where joints slide."""
        return self.arm.feed is None

    @cached_property
    def drive_rows(self) -> FloatArray:
        """Derivatives of the configuration with respect to the unknowns, constant for an affine map, shape (c, p)."""
        return self.slopes(np.zeros(self.dimension))

    @property
    def of_shape(self) -> BoolArray:
        """Mask of the unknowns of base and curve, that is all but the blend weights, shape (p,)."""
        return np.arange(self.dimension) < len(self.scale)

    @property
    def following_rows(self) -> FloatArray:
        """Matrix from changes of unknowns to changes of a fed arm's curve, (m, p) [1/m]; no rows without a feed."""
        return np.zeros((0, self.dimension)) if self.affine else self.change_rows

    @property
    def change_rows(self) -> FloatArray:
        """Matrix from changes of the unknowns to changes of the curve [1/m], shape (2 knots + 2 m, p).

        The first rows give the curvatures at the knots, the others the curvatures that blends add at the m arc lengths
        ``offset_at``, weighted by the spacing of the latter relative to that of the knots. Without blends, the latter
        rows are omitted.
        """
        rows = self.curvature_rows
        if len(self.blends) == 0:
            return rows
        length = self.arm.link_length
        blended = np.zeros((self.blends[0].size, self.dimension))
        turns = self.blends.reshape(len(self.blends), -1)
        blended[:, len(self.scale) :] = np.sqrt(length / self.spacing) * turns.T / length
        return np.concatenate((rows, blended))

    @property
    def curvature_differences(self) -> FloatArray:
        """Matrix from the unknowns to curvature differences between adjacent knots, shape (2 knots − 2, p) [1/m]."""
        rows = self.curvature_rows
        return np.concatenate((np.diff(rows[: self.knots], axis=0), np.diff(rows[self.knots :], axis=0)))

    # ------------------------------------------------------------ places and shapes
    @property
    def _places_at_full_feed(self) -> FloatArray:
        return self.places(sum(axis.high for axis in self.arm.base_axes))

    def places(self, feed: FloatArray | float) -> FloatArray:
        """Return the arc lengths σ of the joints, shape (links,), or (m, links) for feeds of shape (m, 1) [m]."""
        arm = self.arm
        along = arm.joint_places[:-1]
        return np.asarray(along if arm.feed is None else along + feed - arm.hole)

    def _feeds(self, v: FloatArray) -> FloatArray:
        """Return the positions of the k axes that carry the base, shape (m, k) [m, rad]."""
        return np.asarray(v[:, self.axis_columns] * self.scale[self.axis_columns])

    def _joint_arc_lengths(self, feeds: FloatArray) -> FloatArray:
        """Return the arc lengths of the joints, shape (m, links), at positions of the axes of shape (m, k) [m]."""
        places = self.places(np.sum(feeds, axis=1, keepdims=True))
        return np.asarray(np.broadcast_to(places, (len(feeds), self.arm.links)))

    def _turns(self, v: FloatArray, places: FloatArray, shapes: FloatArray) -> FloatArray:
        """Return the bends of the joints about both axes, shape (m, links, 2) [rad].

        Args:
            v: unknowns, shape (m, p).
            places: arc lengths of the joints, shape (m, links) [m].
            shapes: bend of each joint per unit of curvature at each knot, shape (m, links, knots) [m].
        """
        k = self.knots
        turned = self._base_turns
        curvatures = (v[:, turned : turned + 2 * k] * self.scale[turned : turned + 2 * k]).reshape(len(v), 2, k)
        turns = np.matmul(shapes, np.swapaxes(curvatures, 1, 2))
        turns += self._gated(0, places)
        for number, share in enumerate(v[:, len(self.scale) :].T, start=1):
            turns += share[:, None, None] * self._gated(number, places)
        if turned:
            turns[:, 0] += v[:, :2] * self._bent_by_base
        if self._held is not None:
            turns[:, self._held] = 0.0
        return np.asarray(turns)

    def offsets(self, places: FloatArray, v: FloatArray) -> FloatArray:
        """Return the bends that offset and blends add at arc lengths (m,) [m], shape (m, 2) [rad].

        Args:
            places: the arc lengths.
            v: unknowns, shape (p,).
        """
        offsets = self._gated(0, places)
        for number, share in enumerate(v[len(self.scale) :], start=1):
            offsets = offsets + share * self._gated(number, places)
        return offsets

    def _gated(self, number: int, places: FloatArray) -> FloatArray:
        """Return bends of the offset or of a blend at arc lengths, zero inside the guide tube, shape (..., 2) [rad].

        Args:
            number: 0 for the offset, k for the k-th blend.
            places: arc lengths, shape (...) [m].
        """
        first = self._full_from[number]
        if not np.isfinite(first):
            return np.zeros((*places.shape, 2))
        turns = points_at(self.blends[number - 1] if number else self.offset, self.offset_at, places)
        if not self.affine:
            # Between a joint in the guide tube and the first bent one outside, turns grow from where they are allowed
            # to. Each blend has limits of its own, so that further blends leave motions as they are.
            straight = self._straight_before(first)
            gate = np.clip((places - straight) / max(first - straight, 1e-9 * self.arm.length), 0.0, 1.0)
            turns *= gate[..., None]
        return turns

    @cached_property
    def _full_from(self) -> FloatArray:
        """Arc length of the first bent joint of the offset and of each blend, shape (1 + b,) [m]; inf if none bends."""
        if self.full_from is not None:
            return self.full_from
        return np.array([_first_bent(self.offset_at, values) for values in (self.offset, *self.blends)])

    @cached_property
    def straight_before(self) -> float:
        """Arc length beyond the end of the guide tube up to which joints are straight [m].

        If offset or blends bend a joint closer to the tube than the usual value, half the joint's arc length is used:
        the joint has to become straight before it enters the tube, and a smooth path needs some length for that.
        """
        return self._straight_before(float(np.min(self._full_from)))

    def _straight_before(self, first: float) -> float:
        """Return the arc length up to which joints are straight if the first bent one is at ``first`` [m]."""
        usual = free_before(self.arm)
        return usual if first > usual else 0.5 * max(first, 0.0)

    def _shapes(self, places: FloatArray) -> FloatArray:
        """Return the bend of a joint at each arc length [m] per unit of curvature at each knot, (..., knots) [m]."""
        flat = np.ascontiguousarray(places).ravel()
        shapes = np.empty((len(flat), self.knots))
        NativeCall(
            "curve_shapes",
            joints=len(flat), links=self.arm.links, knots=self.knots, spacing=self.spacing, places=flat,
            lengths=self.arm.spine_lengths, shapes=shapes,
        )()  # fmt: skip
        if self.arm.feed is not None:
            shapes *= bend_shares(self.arm, flat)[:, None]
        locked = self.arm.locked_joints
        if locked.any():
            shapes.reshape(-1, self.arm.links, self.knots)[:, locked] = 0.0
        return shapes.reshape(*places.shape, self.knots)


def poses_with(arm: Arm, unknowns: FloatArray, q: FloatArray, slopes: FloatArray) -> tuple[Pose, ...]:
    """Return the poses of an arm in space from its configurations and their derivatives.

    Args:
        arm: the arm.
        unknowns: unknowns of m poses, shape (m, p).
        q: the configurations, shape (m, c) [rad, m].
        slopes: derivatives of the configurations with respect to the unknowns, shape (m, c, p), or (c, p) where they
            are the same for all poses.
    """
    n, m, p = arm.links, len(q), slopes.shape[-1]
    shared = slopes.ndim == 2
    wanted = (len(arm.coordinates), p)
    if q.shape[1:] != wanted[:1] or slopes.shape != (wanted if shared else (m, *wanted)):
        raise ValueError(f"got shapes {q.shape} and {slopes.shape}; expected {len(arm.coordinates)} coordinates")
    points, moving = np.empty((m, n + 1, 3)), np.empty((m, n + 1, 3, p))
    turning, frames = np.empty((m, n, 3, p)), np.empty((m, n, 3, 3))
    NativeCall(
        "chain",
        poses=m, links=n, unknowns=p, lengths=arm.lengths, turns=arm.turns, arcs=arm.arcs, carrier=arm.carrier_for_c,
        base_turning=np.empty((3, p)), q=q, shared=shared, slopes=slopes, points=points, rotations=frames,
        turning=turning, moving=moving,
    )()  # fmt: skip
    each = np.broadcast_to(slopes, (m, *slopes.shape)) if shared else slopes
    return tuple(Pose(*parts) for parts in zip(unknowns, q, each, points, moving, turning, frames, strict=True))


def feed_to_next_stop(curve: CurveMap, feed: float, *, forward: bool) -> float:
    """Return the travel of the base until a joint is just outside the guide tube, where a piece has to end [m].

    Within a piece all coordinates are linear, so a joint that is inside the tube at one end of the piece must not be
    bent at the other.

    Args:
        curve: map of a fed arm.
        feed: feed of the base [m].
        forward: whether the base advances.
    """
    arm = curve.arm
    straight = curve.straight_before
    places = feed + curve.bending_places - arm.hole
    if forward:
        inside = places[places < 0.0]
        return float(-np.max(inside)) + 0.8 * straight if len(inside) else np.inf
    outside = places[places > straight]
    return float(np.min(outside)) - 0.2 * straight if len(outside) else np.inf


def _first_bent(at: FloatArray, values: FloatArray) -> float:
    """Return the first of the arc lengths (m,) at which bends (m, 2) are not zero [m], or inf."""
    bent = np.flatnonzero(np.any(values != 0.0, axis=1))
    return float(at[bent[0]]) if len(bent) else np.inf


def _through(curve: CurveMap, v: FloatArray, q: FloatArray) -> CurveMap:
    """Return a copy of a map with the offset that makes its unknowns (p,) give a configuration (c,) exactly."""
    n = curve.arm.links
    left = (q - curve.configuration(v))[: 2 * n].reshape(n, 2)
    return replace(curve, offset=left, offset_at=curve.places(float(np.sum(q[2 * n :]))))
