"""From the curve to the jointed arm: the paper's even-joint mapping (section 5.3) and a smooth least-squares one."""

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm, MappingName
from ccm_opt.jointed.jointed_settings import DEFAULT_MAPPING, MappingSettings
from ccm_opt.jointed.mapping_even_joints import even_joint_headings
from ccm_opt.jointed.mapping_least_squares import least_squares_headings


def map_curve(
    arm: Arm, configuration: Configuration, method: MappingName, settings: MappingSettings = DEFAULT_MAPPING
) -> FloatArray:
    """Link headings that follow a curve, shape (links,) [rad]; every link keeps its length by construction.

    Args:
        arm: the jointed arm; it is placed at the base of the curve.
        configuration: a curve as long as the arm.
        method: ``even-joints`` puts every second joint on the curve (section 5.3), ``least-squares`` brings all
            joints near their points of the curve with the tip exact.
        settings: tolerances, and the weight that keeps links from zigzagging.

    Raises:
        ProblemError: the lengths differ, or the mapping does not exist for this curve.
    """
    if abs(configuration.length - arm.length) > settings.length_tolerance * arm.length:
        raise ProblemError(
            f"the curve is {configuration.length:.9g} m long but the arm {arm.length:.9g} m "
            f"({arm.links} links of {arm.link_length:g} m); make the segment lengths add up to the arm's length"
        )
    points = curve_points(configuration, arm.links)
    headings = mean_headings(configuration, arm.links)
    if method == "even-joints":
        return even_joint_headings(points, headings, arm.link_length, settings)
    return least_squares_headings(points, headings, arm.link_length, settings)


def mean_headings(configuration: Configuration, links: int) -> FloatArray:
    """Mean heading of the curve over each of ``links`` equal lengths, shape (links,) [rad]; exact."""
    edges = np.linspace(0.0, configuration.length, links + 1)
    means: FloatArray = np.diff(configuration.heading_integral_at(edges)) * (links / configuration.length)
    return means


def curve_points(configuration: Configuration, links: int) -> FloatArray:
    """Points of the curve at equal arc lengths, base and tip included, shape (links + 1, 2) [m]."""
    return configuration.positions_at(np.linspace(0.0, configuration.length, links + 1))


def shape_error(arm: Arm, configuration: Configuration, headings: FloatArray) -> float:
    """Greatest distance of a joint from its own point of the curve, max |P_j - p(s_j)| [m].

    For curvature κ the even-joint mapping gives 0.077 κ l² with the elbow on the bulge side.
    """
    joints = arm.joint_positions(headings) - arm.base + configuration.base
    return float(np.linalg.norm(joints - curve_points(configuration, arm.links), axis=1).max())
