"""A first curve for the NLP: along the taut path, with the spare length as a meander where there is room.

The guess is a heading profile θ(s). Over region r, where the taut path has the length ℓ and the curve gets Λ ≥ ℓ, the
heading swings about the path's by a sin 2πmu, u in [0, 1]: such a curve advances by Λ J₀(a), so J₀(a) = ℓ/Λ takes up
the spare length (Bessel's integral; the modal curves of Chirikjian and Burdick use the same identity). Its m bumps rise
Λ/(2m) H₀(a) from the path, H₀ Struve's function; m is the least that fits the region.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d
from scipy.special import struve

from ccm_opt.arrays import FloatArray
from ccm_opt.continuum.segment_types import SegmentType, end_angle
from ccm_opt.freespace.corridor import ConvexRegion
from ccm_opt.geometry.angles import unit_vector
from ccm_opt.nlp.configuration_task import ConfigurationTask
from ccm_opt.nlp.curve_ode import PIECES
from ccm_opt.nlp.multiple_shooting import ConfigurationNLP, pack
from ccm_opt.nlp.path_profile import PathProfile, region_crossings

_SAMPLES = 401
_SMOOTHING = 0.06
"""Width over which corners of the heading profile are rounded, in units of the arm's length."""
_END_BLEND = 0.12
"""Length over which the heading turns from the base's to the path's and from the path's to the tip's."""
_LEAST_SHARE = 0.05


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
        bulge: +1 swings the spare length to the roomier side of each region, -1 to the other.
    """
    meander = spread_length(nlp, profile, bulge)
    s = np.linspace(0.0, 1.0, _SAMPLES)
    heading = profile.direction_at(np.interp(s, meander.edges, meander.crossings)) + meander.swing(s)
    return _sample(nlp, profile, s, _round(s, heading, profile), _boundaries(nlp.regions, meander.edges))


def spread_length(nlp: ConfigurationNLP, profile: PathProfile, bulge: int) -> Meander:
    """Give each region its stretch of the taut path and, by its area squared, its share of the rest."""
    task, regions = nlp.task, nlp.task.corridor.regions
    crossings = region_crossings(profile, task)
    lengths, taut = curve_shares(task, profile), np.diff(crossings)
    swings = [end_angle(SegmentType.LEFT_RIGHT, min(1.0, t / length)) for t, length in zip(taut, lengths, strict=True)]
    middle = crossings[:-1] + 0.5 * taut
    points, across = profile.point_at(middle) * task.length + task.base, profile.direction_at(middle) + 0.5 * np.pi
    reaches = [_reaches(region, *rest) for region, *rest in zip(regions, points, across, strict=True)]
    left, right = np.array(reaches).T / task.length
    amplitudes, sides = np.array(swings), np.where(left >= right, 1, -1) * bulge
    most = np.minimum(
        np.bincount(nlp.regions, minlength=len(regions)),
        task.curvature_limit * task.length * lengths / (2.0 * np.pi * np.maximum(amplitudes, 1e-9)),
    )
    rise = 0.5 * lengths * struve(0, amplitudes)
    waves = np.clip(
        np.ceil(rise / np.maximum(np.where(sides > 0, left, right), 1e-3)), 1, np.maximum(np.floor(most), 1)
    )
    return Meander(np.append(0.0, np.cumsum(lengths)), crossings, sides * amplitudes, waves)


def curve_shares(task: ConfigurationTask, profile: PathProfile) -> FloatArray:
    """Share of the arm's length that each region gets, shape (regions,): its taut stretch, spare length by area²."""
    regions, taut = task.corridor.regions, np.diff(region_crossings(profile, task))
    areas = np.array([shapely.Polygon(region.vertices).area for region in regions])
    lengths = taut + max(0.0, 1.0 - float(profile.arcs[-1])) * areas**2 / (areas**2).sum()
    lengths = np.maximum(lengths, min(_LEAST_SHARE, 0.5 / len(regions)))
    shares: FloatArray = lengths / lengths.sum()
    return shares


def _reaches(region: ConvexRegion, point: FloatArray, across: float) -> tuple[float, float]:
    """Distance from a point to the region's edge along the heading ``across`` and against it [m]."""
    slack = region.offsets - region.normals @ point
    rate = region.normals @ unit_vector(across)
    ahead, behind = (float((slack[r > 1e-9] / r[r > 1e-9]).min(initial=np.inf)) for r in (rate, -rate))
    return ahead, behind


def _boundaries(regions: tuple[int, ...], edges: FloatArray) -> FloatArray:
    """Arc length at every segment boundary; the segments of one region share it evenly, shape (segments + 1,)."""
    counts = np.bincount(regions, minlength=len(edges) - 1)
    return np.append(0.0, np.cumsum(np.repeat(np.diff(edges) / counts, counts)))


def _round(s: FloatArray, heading: FloatArray, profile: PathProfile) -> FloatArray:
    """Bring the ends to the wanted headings and round the corners."""
    base, tip = profile.base_heading - heading[0], profile.tip_heading - heading[-1]
    heading = heading + base * np.clip(1.0 - s / _END_BLEND, 0.0, 1.0)
    heading = heading + tip * np.clip(1.0 - (1.0 - s) / _END_BLEND, 0.0, 1.0)
    smooth: FloatArray = gaussian_filter1d(heading, _SMOOTHING * len(s), mode="nearest")
    return smooth


def _sample(
    nlp: ConfigurationNLP, profile: PathProfile, s: FloatArray, heading: FloatArray, boundaries: FloatArray
) -> FloatArray:
    """States at the segment boundaries and controls from a sampled heading; positions sheared to meet the goal."""
    steps = (
        np.diff(s)[:, None] * 0.5 * sum(np.column_stack((np.cos(h), np.sin(h))) for h in (heading[1:], heading[:-1]))
    )
    points = np.vstack((np.zeros(2), np.cumsum(steps, axis=0)))
    points += s[:, None] * (profile.points[-1] - points[-1])
    limit = 0.9 * nlp.task.curvature_limit * nlp.task.length
    curvature = np.clip(np.gradient(heading, s), -limit, limit)
    knots = boundaries[:-1, None] + np.diff(boundaries)[:, None] * np.linspace(0.0, 1.0, PIECES + 1)
    values = np.interp(knots, s, curvature)
    bounds = np.minimum(1.1 * np.maximum(np.abs(values[:, 1:]), np.abs(values[:, :-1])) + 0.1, limit)
    controls = np.hstack((values[:, 1:], np.diff(knots, axis=1), bounds))
    at = [np.interp(boundaries, s, column) for column in (*points.T, heading, curvature)]
    guess = pack(np.column_stack((*at, boundaries)), controls)
    return np.clip(guess, nlp.lower, nlp.upper)
