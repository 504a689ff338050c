"""What is tight in space though it is not proved too tight: gaps, lengths and turns on the ways of the arm's axis."""

from collections.abc import Iterator

import numpy as np

from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, TightnessSettings
from ccm_opt.diagnosis.in_space.axis_ways import AxisWays, free_depth, way_length
from ccm_opt.diagnosis.in_space.keyed_space_poses import space_tip_places
from ccm_opt.diagnosis.in_space.reach_in_space import angle_between, most_turn
from ccm_opt.diagnosis.in_space.ways_in_space import between
from ccm_opt.diagnosis.reach import tight_turn
from ccm_opt.diagnosis.words import point
from ccm_opt.errors import Finding
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_words import long_length, short_length
from ccm_opt.ground.length_words import place as at
from ccm_opt.space.problem import SpaceProblem


def tight_in_space(
    problem: SpaceProblem, settings: TightnessSettings = DEFAULT_DIAGNOSIS.tightness
) -> tuple[Finding, ...]:
    """What is likely to stand in the way, the tightest first."""
    found: list[Finding] = []
    for place in space_tip_places(problem):
        ways = AxisWays(problem, place)
        if ways.room > 0.0:
            found += _narrow(ways, settings)
        way = ways.shortest
        if way is not None:
            found += _short(ways, way, settings)
            found += _stiff(ways, way, settings)
    return tuple(sorted(found, key=lambda finding: (finding.measured or 0.0) / max(finding.allowed or 0.0, 1e-300)))


def _narrow(ways: AxisWays, settings: TightnessSettings) -> Iterator[Finding]:
    """The narrowest place of the widest way against the diameter."""
    most = settings.narrow * ways.room
    if ways.search.answer(most, ways.problem.arm.length, ways.settings.more_cells) != "closed":
        return
    known = ways.room if ways.answer == "open" else 0.0
    widest = ways.widest_between(known, most, ways.room if not known else 0.5 * (known + most))
    gap = 2.0 * widest.most
    need = 2.0 * ways.room
    yield Finding(
        "too thick",
        f"the widest way leads through a gap of {short_length(gap)} at most, {between(widest.walls)} at "
        f"{at(widest.place)}, hardly wider than the arm's diameter with its clearance, {short_length(need)}",
        proved=False,
        place=point(widest.place),
        measured=gap,
        allowed=need,
        obstacles=widest.walls,
        way=() if widest.way is None else tuple(point(place) for place in widest.way),
        bounds={"arm.radius": ways.problem.arm.radius},
    )


def _short(ways: AxisWays, way: FloatArray, settings: TightnessSettings) -> Iterator[Finding]:
    """The length of the shortest way that was found against the arm's."""
    arm = ways.problem.arm
    length = way_length(way)
    if arm.length <= settings.short * length:
        yield Finding(
            "too short",
            f"the shortest way that was found is {long_length(length)} long, the arm of {long_length(arm.length)} has "
            "little to spare",
            proved=False,
            measured=arm.length,
            allowed=length,
            bounds={"arm.link_length": arm.link_length},
        )


def _stiff(ways: AxisWays, way: FloatArray, settings: TightnessSettings) -> Iterator[Finding]:
    """The sharpest turn of that way against the tightest bend of the arm, given the room that there is.

    A turn by α round an inner corner from which the arm may be moved outwards by h leaves room for an arc of radius
    h cos(α/2) / (1 − cos(α/2)); links of length l turn by β to a radius l / (2 tan(β/2)).
    """
    arm = ways.problem.arm
    # Limits near half a turn are cut off, where tangent and cosine run away.
    tightest = 0.5 * arm.link_length / np.tan(0.5 * min(most_turn(arm.joint_limit), 0.99 * np.pi))
    corners = simplified(way, ways.room)
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        turn = angle_between(corner - before, after - corner)
        if turn < settings.least_turn:
            continue
        outwards = (corner - before) / np.linalg.norm(corner - before) - (after - corner) / np.linalg.norm(
            after - corner
        )
        outwards /= np.linalg.norm(outwards)
        half = np.cos(0.5 * min(turn, 0.95 * np.pi))
        depth = free_depth(ways.gaps.whole, corner, outwards, ways.room, arm.length)
        radius = depth * half / (1.0 - half)
        if radius <= settings.stiff * tightest:
            walls = ways.walls_beside(corner)[:1]
            yield tight_turn("the shortest way", turn, walls, corner, radius, float(tightest), arm.joint_limit)


def simplified(way: FloatArray, tolerance: float) -> FloatArray:
    """A way without the corners that lie near the straight lines between the others, shape (k, 3) [m].

    A way pulled round something has many corners that turn a little; here they are one. Source: D. Douglas and T.
    Peucker, Algorithms for the reduction of the number of points required to represent a digitized line, 1973.

    Args:
        way: corners, shape (m, 3) [m].
        tolerance: how far from the straight lines corners that are left out may be [m].
    """
    if len(way) < 3:
        return way
    along = way[-1] - way[0]
    share = np.clip((way - way[0]) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    off = np.linalg.norm(way - way[0] - share[:, None] * along, axis=1)
    farthest = int(np.argmax(off))
    if off[farthest] <= tolerance:
        return way[[0, -1]]
    first = simplified(way[: farthest + 1], tolerance)
    return np.concatenate((first[:-1], simplified(way[farthest:], tolerance)))
