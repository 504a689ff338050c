"""Rounding: the bounds that proofs subtract hold against exact arithmetic, at all sizes from 10⁻⁵ to 10⁶."""

from dataclasses import replace
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.scene.certificate import Certificate, proof_rounding
from ccm_opt.scene.contact_finder import CertificateSettings
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from ccm_opt.verification.chain_motion import ChainMotion, TimeIntervals
from ccm_opt.verification.consistency import UNIT, distance_rounding, point_rounding
from ccm_opt.verification.gap_proof import Pairs
from ccm_opt.verification.selfcollision import relative_travels, segment_distances
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from ccm_opt.verification.wall_clearance import check_walls

from .arms import plain_arm

SCALES = st.floats(-5.0, 6.0).map(lambda power: 10.0**power)
SEEDS = st.integers(0, 2**32 - 1)
DIGITS = 50
"""Of exact arithmetic where a root or a sine is taken."""


def exact_sine_and_cosine(angle: Decimal) -> tuple[Decimal, Decimal]:
    """By their series."""
    sine = Decimal(0)
    cosine = Decimal(0)
    term = Decimal(1)
    for n in range(1, 400):
        if n % 2:
            cosine += term if n % 4 == 1 else -term
        else:
            sine += term if n % 4 == 2 else -term
        term = term * angle / n
        if term == 0 or (n > abs(angle) and abs(term) < Decimal(10) ** -DIGITS):
            break
    return sine, cosine


def exact_points(positions: FloatArray, link: float, base: FloatArray, heading: float) -> list[tuple[Decimal, Decimal]]:
    """Joints and tip to fifty digits, the given numbers taken as exact."""
    x, y = (Decimal(float(value)) for value in base)
    angle = Decimal(heading)
    points = [(x, y)]
    for bend in positions:
        angle += Decimal(float(bend))
        sine, cosine = exact_sine_and_cosine(angle)
        x += Decimal(link) * cosine
        y += Decimal(link) * sine
        points.append((x, y))
    return points


@pytest.mark.drawn(20, of="dear tests")
@given(SEEDS, SCALES, st.sampled_from([2, 12, 60]), st.floats(0.0, 7.0))
def test_places_are_off_by_no_more_than_stated(seed: int, scale: float, links: int, far: float) -> None:
    """Every joint of the verifier and the planner, wherever the arm stands, is within the bound of its exact place."""
    rng = np.random.default_rng(seed)
    base = rng.uniform(-1.0, 1.0, 2) * scale * 10.0**far
    arm = plain_arm(links, scale / links, base=base, base_heading=float(rng.uniform(-3.0, 3.0)))
    bends = rng.uniform(-2.0, 2.0, (2, links))
    motion = ChainMotion(arm, np.array([0.0, 0.004]), bends)
    poses = motion.points
    bound = point_rounding(arm, bends)
    room = Workspace(shapely.box(*(base - 4.0 * scale), *(base + 4.0 * scale)))
    of_planner = arm.joint_positions(arm.headings(bends))
    with localcontext() as context:
        context.prec = DIGITS
        for pose, planned, place in zip(poses, of_planner, bends, strict=True):
            exact = exact_points(place, arm.link_length, base, arm.base_heading)
            for found, other, (x, y) in zip(pose, planned, exact, strict=True):
                off = ((Decimal(float(found[0])) - x) ** 2 + (Decimal(float(found[1])) - y) ** 2).sqrt()
                assert off <= Decimal(bound)
                off = ((Decimal(float(other[0])) - x) ** 2 + (Decimal(float(other[1])) - y) ** 2).sqrt()
                # Its headings are inputs of the certificate, and here they are sums, whose rounding comes on top.
                size = abs(arm.base_heading) + float(np.max(np.sum(np.abs(bends), axis=1)))
                summed = np.sqrt(2.0) * arm.length * 1.01 * (links + 4) * UNIT * size
                assert off <= Decimal(proof_rounding(arm, room, 7) + summed)


def exact_squared_distance(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> Fraction:
    """The squared distance of two segments, without any rounding."""
    p, q, r, s = ([Fraction(float(x)) for x in point] for point in (a, b, c, d))

    def side(o: list[Fraction], e: list[Fraction], f: list[Fraction]) -> Fraction:
        return (e[0] - o[0]) * (f[1] - o[1]) - (e[1] - o[1]) * (f[0] - o[0])

    def from_end(o: list[Fraction], e: list[Fraction], f: list[Fraction]) -> Fraction:
        u = [f[0] - e[0], f[1] - e[1]]
        w = [o[0] - e[0], o[1] - e[1]]
        square = u[0] ** 2 + u[1] ** 2
        t = min(max((w[0] * u[0] + w[1] * u[1]) / square, Fraction(0)), Fraction(1)) if square else Fraction(0)
        return (w[0] - t * u[0]) ** 2 + (w[1] - t * u[1]) ** 2

    if side(p, q, r) * side(p, q, s) < 0 and side(r, s, p) * side(r, s, q) < 0:
        return Fraction(0)
    return min(from_end(p, r, s), from_end(q, r, s), from_end(r, p, q), from_end(s, p, q))


def segments_of(rng: np.random.Generator, scale: float, kind: int) -> FloatArray:
    """Two segments: anyhow, nearly in line, crossing by next to nothing, one very long, or one next to a point."""
    ends = rng.uniform(-1.0, 1.0, (4, 2))
    if kind == 1:
        ends[2:] = ends[0] + np.outer(rng.uniform(-2.0, 2.0, 2), ends[1] - ends[0])
        ends[2:] += 1e-16 * rng.integers(-3, 4, (2, 2))
    elif kind == 2:
        ends[2] = ends[0] + rng.uniform(0.0, 1.0) * (ends[1] - ends[0]) + 1e-15 * rng.uniform(-1.0, 1.0, 2)
    elif kind == 3:
        ends[3] = ends[2] + 1e6 * (ends[3] - ends[2])
    elif kind == 4:
        ends[3] = ends[2] + 1e-17 * rng.uniform(-1.0, 1.0, 2)
    return ends * scale


@given(SEEDS, SCALES, st.integers(0, 4))
def test_distances_are_off_by_no_more_than_stated(seed: int, scale: float, kind: int) -> None:
    """Distances of segments, crossing ones and those in line included, are within the bound of exact ones."""
    ends = segments_of(np.random.default_rng(seed), scale, kind)
    found = float(segment_distances(*(end[None] for end in ends))[0])
    with localcontext() as context:
        context.prec = DIGITS
        square = exact_squared_distance(*ends)
        exact = (Decimal(square.numerator) / Decimal(square.denominator)).sqrt()
        assert abs(Decimal(found) - exact) <= Decimal(distance_rounding(float(np.max(np.abs(ends)))))


@given(SEEDS, SCALES, st.sampled_from([4, 40, 400]))
def test_ways_between_links_are_not_rounded_down(seed: int, scale: float, links: int) -> None:
    """The bound on how far one link moves, seen from another, is no less than what it does in exact arithmetic."""
    rng = np.random.default_rng(seed)
    arm = plain_arm(links, scale / links)
    bends = rng.uniform(-2.0, 2.0, (2, links))
    # Turns of the first joint alone are the worst that running sums can be given.
    bends[1, 1:] = bends[0, 1:] + rng.uniform(-1e-13, 1e-13, links - 1) * (seed % 2)
    motion = ChainMotion(arm, np.array([0.0, 0.004]), bends)
    first = int(rng.integers(0, links - 2))
    last = int(rng.integers(first + 2, links))
    interval = TimeIntervals(np.array([0.0]), np.array([1.0]))
    pairs = Pairs(np.array([0]), np.array([first]), np.array([last]))
    found = relative_travels(motion, interval, motion.travels(interval), pairs)[0]
    points = motion.poses(np.array([0.0, 0.5, 1.0]))
    apart = segment_distances(points[:, first], points[:, first + 1], points[:, last], points[:, last + 1])
    rounding = 4.0 * motion.rounding + 2.0 * distance_rounding(motion.size)
    assert np.all(np.abs(apart - apart[1]) <= found + rounding)


@pytest.mark.parametrize("power", [-5, 0, 6])
def test_an_arm_far_from_the_origin_is_refused_rather_than_believed(power: int) -> None:
    """Where rounding is more than the gap, nothing is proved, by the verifier or by the certificate."""
    scale = 10.0**power
    for far, proved in ((1.0, True), (1e13, False)):
        base = np.array([far * scale, 0.0])
        arm = plain_arm(2, 0.5 * scale, radius=0.0, base=base)
        wall = Obstacle("shelf", PlaneShape(shapely.box(*(base + scale * np.array([0.2, 1e-4])), *(base + scale))))
        room = Workspace(shapely.box(*(base - 9.0 * scale), *(base + 9.0 * scale)), (wall,))
        still = np.zeros((2, 2))
        settings = replace(
            DEFAULT_VERIFICATION,
            touch=1e-9 * scale,
            contact_tolerance=1e-6 * scale,
            resolution=1e-9 * scale,
            report_resolution=1e-4 * scale,
        )
        assert check_walls(ChainMotion(arm, np.array([0.0, 0.004]), still), room, settings).passed is proved
        certificate = Certificate(arm, room, settings=CertificateSettings(touch=1e-9 * scale))
        assert (len(certificate.failures(still)) == 0) is proved
