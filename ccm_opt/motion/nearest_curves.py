"""The continuous curves behind poses of the links: whose mean headings come nearest to theirs."""

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.segment import CurvatureSegment
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.link_space import SEGMENTS, LinkSpace, fit_coordinates, mean_heading_matrix, turns_before_segments


def nearest_curve(arm: Arm, headings: FloatArray) -> Configuration:
    """The continuous curve whose mean headings on the links come nearest to given ones, shape (links,) [rad]."""
    space, v = LinkSpace.through(arm, headings)
    return space.curve(v)


def nearest_curves(arm: Arm, headings: FloatArray) -> tuple[Configuration, ...]:
    """The same, but for rounding, for many poses at once, shape (k, links) [rad]; in a fortieth of the time."""
    coordinates = fit_coordinates(mean_heading_matrix(arm.links, arm.length), headings.T, arm.length).T
    length = arm.length / SEGMENTS
    begin = coordinates[:, :1] + arm.length * coordinates[:, 1:] @ turns_before_segments().T
    curvatures = [coordinates[:, 1 + 4 * k : 6 + 4 * k] for k in range(SEGMENTS)]
    return tuple(
        Configuration(
            arm.base, tuple(CurvatureSegment(length, float(begin[i, k]), curvatures[k][i]) for k in range(SEGMENTS))
        )
        for i in range(len(coordinates))
    )
