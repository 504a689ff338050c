"""Checks of goals from which the arm looks at a place: distance, field of view, surface normal, and line of sight.

The line of sight runs from the tip to the place. It is free if it and a cone about it, with its apex at the place,
touch neither obstacles nor the arm. The place usually lies on a surface, so that the last hundredth of the cone, where
it is thinner than the errors of meshes, does not count; of the line itself, only a rounding of the place does not
count, and, for surfaces with errors, a few times these. Points of a scan that are as near to the place are taken to be
of the surface that it lies on.
"""

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import LookAt
from ccm_opt.problem.solution import Check
from ccm_opt.verification.chain_motion import ChainMotion, pointing
from ccm_opt.verification.consistency import distance_rounding
from ccm_opt.verification.selfcollision import link_word, segment_distances
from ccm_opt.verification.wall_clearance import CheckedSurfaces

SIGHT_HALF_ANGLE = float(np.deg2rad(0.5))
"""Required half angle of the free cone about a line of sight [rad]. Assumed: 9 mm at a metre."""
_SEEN = 10.0
"""Largest half angle that is measured, in multiples of the required one."""
_END = 0.01
"""Fraction of the cone, at the place, that does not count; see above."""
_ROUNDED = 1e-4
"""Fraction of the line itself, at the place, that does not count: rounding of coordinates in files. Heuristic."""
_ERRORS = 4.0
"""Length of the line, at the place, within which a surface does not count, in multiples of the surface's error. A line
at 60° to the normal crosses twice the error within this."""
_PIECES_AT_END = 16
"""Number of pieces of the line between both ends."""
_RATIO = 1.1
"""Ratio of the distances from the place of both ends of a piece of the line. The cone about a piece is taken to be as
wide as at its farther end, so that half angles are underestimated by up to a tenth."""
_ROUNDING = 1e-9
"""Angle beyond its limit that counts as rounding [rad], and distance, as a fraction of the distance."""


def check_view(
    name: str,
    surfaces: CheckedSurfaces | None,
    motion: ChainMotion,
    sample: int,
    look_at: LookAt,
    errors: FloatArray | None = None,
) -> list[Check]:
    """Check that the arm looks at a place in a sample: distance, field of view, angle to the normal, line of sight.

    Args:
        name: prefix of the names of the checks.
        surfaces: bounding-box tree of the obstacles' surfaces; None if there are none.
        motion: motion of the arm, with its tool.
        sample: index of the sample.
        look_at: the place, and the conditions.
        errors: how far true surfaces may be from those of each obstacle [m]; None if all are exact.
    """
    tip = motion.points[sample, -1]
    sight = look_at.place - tip
    distance = float(np.linalg.norm(sight))
    least, most = look_at.distance
    when = f"tip at t = {motion.time[sample]:.4f} s"
    slack = _ROUNDING * most
    checks = [
        Check(f"{name}least distance", distance, least, "m", when, passed=distance >= least - slack),
        Check(f"{name}greatest distance", distance, most, "m", when, passed=distance <= most + slack),
    ]

    off = _angle(sight, pointing(motion, sample))
    bound = 0.5 * look_at.field_of_view
    checks.append(Check(f"{name}field of view", off, bound, "rad", when, passed=off <= bound + _ROUNDING))
    if look_at.normal is not None:
        off = _angle(-sight, look_at.normal)
        passed = off <= look_at.angle + _ROUNDING
        checks.append(Check(f"{name}normal", off, look_at.angle, "rad", when, passed=passed))

    free, nearest = free_half_angle(surfaces, motion, sample, look_at.place, errors)
    passed = free >= SIGHT_HALF_ANGLE
    checks.append(Check(f"{name}line of sight", free, SIGHT_HALF_ANGLE, "rad", f"{nearest}, {when}", passed=passed))
    return checks


def _angle(one: FloatArray, other: FloatArray) -> float:
    """Return the angle between two vectors, accurate for small angles too [rad]."""
    one, other = one / max(float(np.linalg.norm(one)), 1e-300), other / np.linalg.norm(other)
    return 2.0 * float(np.arctan2(np.linalg.norm(one - other), np.linalg.norm(one + other)))


def free_half_angle(
    surfaces: CheckedSurfaces | None,
    motion: ChainMotion,
    sample: int,
    place: FloatArray,
    errors: FloatArray | None = None,
) -> tuple[float, str]:
    """Return a lower bound on the half angle of the free cone about a line of sight [rad], and what limits it.

    The half angle is capped at ``_SEEN`` times the required one. Links and parts of the tool that contain the tip
    carry the camera, and do not hide anything.

    Args:
        surfaces: bounding-box tree of the obstacles' surfaces; None if there are none.
        motion: motion of the arm, with its tool.
        sample: index of the sample in which the arm looks.
        place: the place that it looks at, shape (d,) [m].
        errors: how far true surfaces may be from those of each obstacle [m]; None if all are exact.
    """
    angles, names = free_half_angles(surfaces, motion, sample, place[None], errors)
    return float(angles[0]), str(names[0])


def free_half_angles(
    surfaces: CheckedSurfaces | None,
    motion: ChainMotion,
    sample: int,
    places: FloatArray,
    errors: FloatArray | None = None,
) -> tuple[FloatArray, npt.NDArray[np.object_]]:
    """Return lower bounds on the half angles of the free cones about lines of sight to m places, and what limits each.

    Arguments are those of ``free_half_angle``, but for the places, shape (m, d) [m]. Both results have shape (m,).
    """
    arm, points = motion.arm, motion.points[sample]
    tip = points[-1]
    count = int(np.ceil(-np.log(_END) / np.log(_RATIO)))
    shares = np.append(np.geomspace(_ROUNDED, _END, _PIECES_AT_END + 1)[:-1], np.geomspace(_END, 1.0, count + 1))
    ends = places[:, None] + shares[:, None] * (tip - places)[:, None]
    form, d = (len(places), len(shares) - 1), len(tip)
    start, end = ends[:, :-1].reshape(-1, d), ends[:, 1:].reshape(-1, d)
    away = np.linalg.norm(tip - places, axis=1)[:, None]
    far = shares[1:] * away
    rounding = distance_rounding(float(np.max(np.abs(ends), initial=motion.size)))
    # Gaps of the line itself at its end are compared with rounding only.
    line = np.arange(form[1]) < _PIECES_AT_END
    gaps = np.where(line, 2.0 * rounding, far * np.tan(_SEEN * SIGHT_HALF_ANGLE)).ravel()
    names = np.full(len(gaps), "nothing near", dtype=object)
    if surfaces is not None:
        blind = np.zeros(len(surfaces.names)) if errors is None else _ERRORS * errors[: len(surfaces.names)]
        counted = np.where(line, shares[:-1] * away, np.inf).ravel()
        _to_surfaces(surfaces, start, end, np.repeat(places, form[1], axis=0), gaps, names, counted, blind)
    bare = np.zeros(arm.links, dtype=bool) if arm.tool_links is None else arm.tool_links.bare
    for link in np.flatnonzero(~bare):
        one, other = points[link], points[link + 1]
        if float(segment_distances(tip[None], tip[None], one[None], other[None])[0]) <= arm.radii[link]:
            continue
        k = len(gaps)
        apart = segment_distances(start, end, np.tile(one, (k, 1)), np.tile(other, (k, 1))) - arm.radii[link]
        names[apart < gaps] = link_word(arm, int(link))
        np.minimum(gaps, apart, out=gaps)
    gaps, names = gaps.reshape(form), names.reshape(form)
    every = np.arange(len(places))
    slopes = (gaps - rounding)[:, ~line] / far[:, ~line]
    worst = np.argmin(slopes, axis=1)
    angles, limiting = np.arctan(np.maximum(slopes[every, worst], 0.0)), names[:, ~line][every, worst]
    crossed = gaps[:, line] <= rounding
    first = np.argmax(crossed, axis=1)
    hidden = crossed[every, first]
    return np.where(hidden, 0.0, angles), np.where(hidden, names[:, line][every, first], limiting)


def _to_surfaces(
    surfaces: CheckedSurfaces,
    start: FloatArray,
    end: FloatArray,
    place: FloatArray,
    gaps: FloatArray,
    names: npt.NDArray[np.object_],
    away: FloatArray,
    blind: FloatArray,
) -> None:
    """Lower the gaps of pieces of a line, in place, to those from surfaces, and name the nearest ones.

    Args:
        surfaces: bounding-box tree of the surfaces.
        start: starts of the pieces, shape (k, d) [m].
        end: ends of the pieces, shape (k, d) [m].
        place: the place that each is towards, shape (k, d) [m].
        gaps: gaps that are lowered, shape (k,) [m].
        names: names of what is nearest to each piece, shape (k,).
        away: distance of each piece from the place, infinite if all surfaces count, shape (k,) [m].
        blind: distance from the place within which each obstacle does not count, by its number, nor do the points of a
            scan at all [m].
    """
    piece = np.arange(len(start))
    node = np.zeros(len(start), dtype=np.intp)
    while len(piece):
        low = surfaces.bounds(node, start[piece], end[piece])[0] - surfaces.rounding[node]
        near = low < gaps[piece]
        piece, node = piece[near], node[near]
        single = surfaces.is_single(node)
        if np.any(single):
            owner = surfaces.owner[node[single] - surfaces.offsets[-2]]
            corners = surfaces.edge_parts(node[single])
            beside = np.linalg.norm(corners[:, 0] - place[piece[single]], axis=1) < blind[owner]
            scanned = np.all(corners == corners[:, :1], axis=(1, 2))
            counts = (away[piece[single]] >= blind[owner]) & ~(scanned & beside)
            mine, parts = piece[single][counts], node[single][counts]
            apart = surfaces.separations(parts, start[mine], end[mine])[0] - surfaces.rounding[parts]
            for k in np.argsort(-apart):
                if apart[k] < gaps[mine[k]]:
                    gaps[mine[k]], names[mine[k]] = apart[k], f"'{surfaces.name_of(int(parts[k]))}'"
        parent, node = surfaces.children(node[~single])
        piece = piece[~single][parent]
