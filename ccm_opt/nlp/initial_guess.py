"""A first curve for the NLP: along the taut path, with the surplus length as a meander where there is room.

The guess is a heading profile θ(s). Over region r, where the taut path has the length ℓ and the curve gets Λ ≥ ℓ, the
heading swings about the path's by a sin 2πmu, u in [0, 1]: such a curve advances by Λ J₀(a), so J₀(a) = ℓ/Λ takes up
the surplus length (Bessel's integral; the modal curves of Chirikjian and Burdick use the same identity). Its m bumps
rise Λ/(2m) H₀(a) from the path, H₀ Struve's function; m is the least that fits the region.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d
from scipy.special import struve

from ccm_opt.continuum.segment import PIECES
from ccm_opt.continuum.segment_types import SegmentType, end_angle
from ccm_opt.freespace.corridor import ConvexRegion
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.nlp.configuration_settings import ConfigurationSettings
from ccm_opt.nlp.configuration_task import ConfigurationTask
from ccm_opt.nlp.multiple_shooting import ConfigurationNLP, pack_variables
from ccm_opt.nlp.path_profile import PathProfile, region_crossings


@dataclass(frozen=True)
class Meander:
    """How the arm's length is spread over the regions, all lengths in units of the arm's.

    Attributes:
        edges: arc length of the curve at the regions' boundaries, shape (regions + 1,).
        crossings: length of the taut path there, shape (regions + 1,).
        amplitudes: swing a of the heading in each region, positive to the left first [rad], shape (regions,).
        waves: number m of bumps in each region, shape (regions,).
    """

    edges: FloatArray
    crossings: FloatArray
    amplitudes: FloatArray
    waves: FloatArray

    def swing(self, s: FloatArray) -> FloatArray:
        """Heading added to the path's, a sin 2πmu over each region [rad]."""
        region = np.clip(np.searchsorted(self.edges, s, side="right") - 1, 0, len(self.amplitudes) - 1)
        u = (s - self.edges[region]) / np.diff(self.edges)[region]
        added: FloatArray = self.amplitudes[region] * np.sin(2.0 * np.pi * self.waves[region] * u)
        return added


def initial_guess(nlp: ConfigurationNLP, profile: PathProfile, bulge: int = 1) -> FloatArray:
    """Variables of the NLP near a smooth curve along a path, shape (variables,).

    Args:
        nlp: the NLP to start.
        profile: the path's headings.
        bulge: +1 swings the surplus length to the roomier side of each region, -1 to the other.
    """
    meander = spread_length(nlp, profile, bulge)
    s = np.linspace(0.0, 1.0, nlp.task.settings.guess_samples)
    heading = profile.direction_at(np.interp(s, meander.edges, meander.crossings)) + meander.swing(s)
    smooth = _rounded(s, heading, profile, nlp.task.settings)
    return _sample(nlp, profile, s, smooth, _boundaries(nlp.regions, meander.edges))


def spread_length(nlp: ConfigurationNLP, profile: PathProfile, bulge: int) -> Meander:
    """Give each region its stretch of the taut path and, by its area squared, its share of the rest."""
    task = nlp.task
    regions = task.corridor.regions
    crossings = region_crossings(profile, task)
    lengths = curve_shares(task, profile)
    taut = np.diff(crossings)

    # The swing that takes up each region's surplus length, to the side with more room in the middle of its stretch.
    swings = [end_angle(SegmentType.LEFT_RIGHT, min(1.0, t / length)) for t, length in zip(taut, lengths, strict=True)]
    amplitudes = np.array(swings)
    middle = crossings[:-1] + 0.5 * taut
    points = profile.point_at(middle) * task.length + task.base
    across = profile.direction_at(middle) + 0.5 * np.pi
    reaches = [_reaches(region, *rest) for region, *rest in zip(regions, points, across, strict=True)]
    left, right = np.array(reaches).T / task.length
    sides = np.where(left >= right, 1, -1) * bulge

    # As few bumps as fit that room; no more than there are segments to make them, nor than the curvature allows.
    rise = 0.5 * lengths * struve(0, amplitudes)
    fitting = np.ceil(rise / np.maximum(np.where(sides > 0, left, right), 1e-3))
    segments = np.bincount(nlp.regions, minlength=len(regions))
    bendable = task.curvature_limit * task.length * lengths / (2.0 * np.pi * np.maximum(amplitudes, 1e-9))
    most = np.floor(np.minimum(segments, bendable))
    waves = np.clip(fitting, 1, np.maximum(most, 1))
    return Meander(np.append(0.0, np.cumsum(lengths)), crossings, sides * amplitudes, waves)


def curve_shares(task: ConfigurationTask, profile: PathProfile) -> FloatArray:
    """Share of the arm's length that each region gets, shape (regions,): its taut stretch, surplus length by area²."""
    regions = task.corridor.regions
    taut = np.diff(region_crossings(profile, task))
    areas = np.array([shapely.Polygon(region.vertices).area for region in regions])
    lengths = taut + max(0.0, 1.0 - float(profile.arcs[-1])) * areas**2 / (areas**2).sum()
    lengths = np.maximum(lengths, min(task.settings.least_region_share, 0.5 / len(regions)))
    shares: FloatArray = lengths / lengths.sum()
    return shares


def _reaches(region: ConvexRegion, point: FloatArray, across: float) -> tuple[float, float]:
    """Distance from a point to the region's edge along the heading ``across`` and against it [m]."""
    slack = region.offsets - region.normals @ point
    rate = region.normals @ unit_vector(across)
    ahead = rate > 1e-9
    behind = rate < -1e-9
    return (
        float((slack[ahead] / rate[ahead]).min(initial=np.inf)),
        float((slack[behind] / -rate[behind]).min(initial=np.inf)),
    )


def _boundaries(regions: tuple[int, ...], edges: FloatArray) -> FloatArray:
    """Arc length at every segment boundary; the segments of one region share it evenly, shape (segments + 1,)."""
    counts = np.bincount(regions, minlength=len(edges) - 1)
    return np.append(0.0, np.cumsum(np.repeat(np.diff(edges) / counts, counts)))


def _rounded(s: FloatArray, heading: FloatArray, profile: PathProfile, settings: ConfigurationSettings) -> FloatArray:
    """Sampled headings (m,) [rad] with the ends brought to the wanted headings and the corners rounded."""
    base = profile.base_heading - heading[0]
    tip = profile.tip_heading - heading[-1]
    heading = heading + base * np.clip(1.0 - s / settings.end_blend, 0.0, 1.0)
    heading = heading + tip * np.clip(1.0 - (1.0 - s) / settings.end_blend, 0.0, 1.0)
    smooth: FloatArray = gaussian_filter1d(heading, settings.corner_rounding * len(s), mode="nearest")
    return smooth


def _sample(
    nlp: ConfigurationNLP, profile: PathProfile, s: FloatArray, heading: FloatArray, boundaries: FloatArray
) -> FloatArray:
    """States at the segment boundaries and controls from a sampled heading; positions sheared to meet the goal."""
    # Trapezium rule, then a shear: the tip's distance from the goal is spread evenly over the arm's length.
    tangents = unit_vector(heading)
    steps = 0.5 * np.diff(s)[:, None] * (tangents[1:] + tangents[:-1])
    points = np.vstack((np.zeros(2), np.cumsum(steps, axis=0)))
    points += s[:, None] * (profile.points[-1] - points[-1])

    limit = nlp.task.settings.guess_curvature * nlp.task.curvature_limit * nlp.task.length
    curvature = np.clip(np.gradient(heading, s), -limit, limit)
    knots = boundaries[:-1, None] + np.diff(boundaries)[:, None] * np.linspace(0.0, 1.0, PIECES + 1)
    values = np.interp(knots, s, curvature)
    # The bounds on |κ| start a little above what they bound, inside their rows.
    bounds = np.minimum(1.1 * np.maximum(np.abs(values[:, 1:]), np.abs(values[:, :-1])) + 0.1, limit)
    controls = np.hstack((values[:, 1:], np.diff(knots, axis=1), bounds))
    at = [np.interp(boundaries, s, column) for column in (*points.T, heading, curvature)]
    guess = pack_variables(np.column_stack((*at, boundaries)), controls)
    return np.clip(guess, nlp.lower, nlp.upper)
