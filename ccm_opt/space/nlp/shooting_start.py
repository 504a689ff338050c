"""Values of the NLP's variables at a pose: the curve near it, its turns and frames, the links, the points."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.segment import PIECES
from ccm_opt.continuum.spline import second_derivatives
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.space.curve.curve_space import CurveSpace
from ccm_opt.space.curve.rigid_motions import exponential
from ccm_opt.space.curve.space_configuration import SpaceConfiguration
from ccm_opt.space.nlp.quaternions import chained_quaternions, quaternions_of


@dataclass(frozen=True)
class CurveNumbers:
    """A curve of the NLP in numbers; lengths in units of the arm's length.

    Attributes:
        arcs: of the knots, shape (4 K + 1,).
        curvatures: κ1 and κ2 there, shape (2, 4 K + 1).
        base_turn: to the left and upwards, shape (2,) [rad].
    """

    arcs: FloatArray
    curvatures: FloatArray
    base_turn: FloatArray

    @classmethod
    def near(cls, arm: SpaceArm, q: FloatArray, segments: int) -> "CurveNumbers":
        """The curve with even knots whose bends come nearest to those of a pose, shape (c,)."""
        knots = PIECES * segments + 1
        space = CurveSpace.of(arm, knots)
        v = space.nearest(q)
        curvatures = (space.curvature_rows @ v).reshape(2, knots) * arm.length
        turns = (v * space.scales)[[0, knots + 1]]
        return cls(np.linspace(0.0, 1.0, knots), curvatures, turns)

    @property
    def segments(self) -> int:
        """Number of curvature segments K."""
        return (len(self.arcs) - 1) // PIECES

    def segment_values(self) -> tuple[list[float], list[FloatArray], list[tuple[float, float, float]]]:
        """Lengths, curvatures (5, 2) and inner knots of the segments."""
        lengths = []
        values = []
        shares = []
        for segment in range(self.segments):
            inside = slice(PIECES * segment, PIECES * (segment + 1) + 1)
            arcs = self.arcs[inside]
            lengths.append(float(arcs[-1] - arcs[0]))
            values.append(self.curvatures[:, inside].T.copy())
            inner = (arcs[1:-1] - arcs[0]) / lengths[-1]
            shares.append((float(inner[0]), float(inner[1]), float(inner[2])))
        return lengths, values, shares

    def configuration(self, arm: SpaceArm, feed: float) -> SpaceConfiguration:
        """The curve in metres, from where the base is carried so far [m]."""
        lengths, values, shares = self.segment_values()
        rotation, _ = exponential(np.array([0.0, -self.base_turn[1], self.base_turn[0], 0.0, 0.0, 0.0]))
        return SpaceConfiguration.chain(
            arm.base + feed * arm.direction,
            arm.base_rotation @ rotation,
            [arm.length * length for length in lengths],
            [value / arm.length for value in values],
            shares,
        )

    def link_turns(self, links: int) -> tuple[FloatArray, FloatArray]:
        """Ω and ψ of every link, as ``BishopShooting`` has them, each of shape (n, 2) [rad]."""
        joints = np.linspace(0.0, 1.0, links + 1)
        turns = np.zeros((links, 2))
        means = np.zeros((links, 2))
        for index in (0, 1):
            flat = self.planar(index)
            at_joints = flat.heading_at(joints)
            turns[:, index] = np.diff(at_joints)
            means[:, index] = np.diff(flat.heading_integral_at(joints)) * links - at_joints[:-1]
        return turns, means

    def directions(self, links: int) -> FloatArray:
        """Mean directions over the links, in the axes of the base, as ``BishopShooting`` has them, shape (n, 3)."""
        turns, means = self.link_turns(links)
        size = np.linalg.norm(means, axis=1)
        local = np.concatenate((np.cos(size)[:, None], np.sinc(size / np.pi)[:, None] * means), axis=1)
        frames = _curve_frames(self.base_turn, turns, means)
        # q v q̄ = v + 2 w (u × v) + 2 u × (u × v) with q = (w, u)
        vector = frames[:, 1:]
        crossed = np.cross(vector, local)
        return np.asarray(local + 2.0 * (frames[:, :1] * crossed + np.cross(vector, crossed)))

    def planar(self, index: int) -> Configuration:
        """The curve of the plane with one of the curvatures, whose headings are its turns."""
        lengths, values, shares = self.segment_values()
        return Configuration.chain(np.zeros(2), 0.0, lengths, [value[:, index] for value in values], shares)


def start_values(arm: SpaceArm, q: FloatArray, curve: CurveNumbers, moment_scale: float) -> FloatArray:
    """Values of the first variables, up to the feed, in the order of ``SpacePoseProgram.variables``.

    Args:
        arm: the arm.
        q: the pose, shape (c,).
        curve: near it.
        moment_scale: of ``LiftedCurve``.
    """
    values = [curve.arcs]
    turns, means = curve.link_turns(arm.links)
    lengths, of_segments, shares = curve.segment_values()
    widths = [length * np.diff([0.0, *inner, 1.0]) for length, inner in zip(lengths, shares, strict=True)]
    for index in (0, 1):
        flat = curve.planar(index)
        values += [curve.curvatures[index], flat.heading_at(curve.arcs), flat.heading_integral_at(curve.arcs)]
        pairs = zip(widths, of_segments, strict=True)
        moments = [second_derivatives(width, value[:, index])[1:-1] for width, value in pairs]
        values.append(np.concatenate(moments) / moment_scale)
    values += [curve.base_turn, turns.ravel(), means.ravel(), _curve_frames(curve.base_turn, turns, means).ravel()]
    bends = arm.bend_pairs(q)
    points = (joint_positions(arm, q) - arm.base) @ arm.base_rotation / arm.length
    feed = arm.coordinates.advance(q) / arm.length
    return np.concatenate((*values, bends.ravel(), link_quaternions(bends).ravel(), points.ravel(), [feed]))


def link_quaternions(bends: FloatArray) -> FloatArray:
    """Quaternions of links turned by bends, shape (n, 2) to (n, 4)."""
    zero = np.zeros(len(bends))
    about_z = quaternions_of(np.column_stack((zero, zero, bends[:, 0])))
    about_y = quaternions_of(np.column_stack((zero, bends[:, 1], zero)))
    return chained_quaternions(np.stack((about_z, about_y), axis=1).reshape(-1, 4))[1::2]


def _curve_frames(base_turn: FloatArray, turns: FloatArray, means: FloatArray) -> FloatArray:
    """Frames at the beginnings of the links, as ``BishopShooting`` has them, shape (n, 4)."""
    roll = means[:, 0] * turns[:, 1] - means[:, 1] * turns[:, 0]
    steps = np.column_stack((roll, -turns[:, 1], turns[:, 0]))[:-1]
    first = np.array([[0.0, -base_turn[1], base_turn[0]]])
    return chained_quaternions(quaternions_of(np.concatenate((first, steps))))
