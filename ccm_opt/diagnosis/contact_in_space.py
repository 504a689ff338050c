"""Necessary checks of poses in space."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.length_words import place as at
from ccm_opt.core.length_words import short_length
from ccm_opt.diagnosis.contact import (
    carried_weights,
    contact_finding,
    gap_words,
    joint_words,
    lighter_by_play,
    overloaded,
)
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS
from ccm_opt.diagnosis.keyed_poses import SpaceTipPlace, WholeSpacePose, space_tip_places, whole_space_poses
from ccm_opt.diagnosis.ranking import point
from ccm_opt.diagnosis.reach_in_space import supple_enough_in_space, within_space_joint_limits, within_space_reach
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.errors import Finding
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.scene.bodies import CylinderBody
from ccm_opt.scene.distances.enclosures import deepest_enclosure, segment_distances
from ccm_opt.scene.distances.insides import depth_inside
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import SurfaceSoup
from ccm_opt.scene.workspace import ROOM_NAME, Obstacle, Workspace

_SAMPLES = np.linspace(0.0, 1.0, 9)
"""Places along a segment at which its depth is measured; between them it is hardly deeper."""


@dataclass(frozen=True)
class ObstacleGap:
    """How far segments are from one obstacle.

    Attributes:
        name: of the obstacle, or what the room is called.
        gaps: distance of each segment's axis from it, negative by how deep it is inside, shape (k,) [m].
        places: where the obstacle, or else the segment, is deepest in the other or nearest, shape (k, 3) [m].
        error: by how much the surfaces that are looked at may stand out of the obstacle itself [m].
        outside: whether it is the room, and a segment reaches out of it.
    """

    name: str
    gaps: FloatArray
    places: FloatArray
    error: float = 0.0
    outside: bool = False


@dataclass(frozen=True, eq=False)
class ObstacleGaps:
    """Distances from every obstacle of a scene.

    Args:
        workspace: the scene.
    """

    workspace: Workspace

    @cached_property
    def whole(self) -> SurfaceTree:
        """All surfaces at once."""
        return SurfaceTree.of(self.workspace.soup)

    def of(self, segments: FloatArray, reach: float) -> Iterator[ObstacleGap]:
        """Every obstacle, and the room, that is nearer to some segment than a distance.

        Args:
            segments: ends, shape (k, 2, 3) [m].
            reach: distances are cut off here [m].
        """
        low = segments.min(axis=(0, 1)) - reach
        high = segments.max(axis=(0, 1)) + reach
        for obstacle in self.workspace.obstacles:
            body = obstacle.body
            triangles = body.triangles
            apart = (triangles.min(axis=(0, 1)) - body.rounding > high) | (
                triangles.max(axis=(0, 1)) + body.rounding < low
            )
            if not np.any(apart):
                found = _from_obstacle(obstacle, segments, reach)
                if float(found.gaps.min()) < reach:
                    yield found
        if self.workspace.bounds is not None:
            found = _from_room(self.workspace.bounds, segments)
            if float(found.gaps.min()) < reach:
                yield found


def _from_obstacle(obstacle: Obstacle, segments: FloatArray, reach: float) -> ObstacleGap:
    """Distances from one obstacle: from its surface, and inside of it the depth."""
    body = obstacle.body
    tree = SurfaceTree.of(SurfaceSoup.joined([(obstacle.name, body.triangles, body.rounding)]))
    near = tree.nearest(segments, reach)
    gaps = near.gap.copy()
    places = near.point.copy()
    # Balls and bars have no triangle with an area: distances from them are depths already.
    if body.closed and body.rounding == 0.0:
        for k, segment in enumerate(segments):
            along = segment[0] + _SAMPLES[:, None] * (segment[1] - segment[0])
            depths = [depth_inside(body, place) for place in along]
            deepest = int(np.argmax(depths))
            if depths[deepest] > 0.0:
                gaps[k] = -depths[deepest]
                places[k] = along[deepest]
    return ObstacleGap(obstacle.name, gaps, places, stands_out(obstacle))


def stands_out(obstacle: Obstacle) -> float:
    """By how much the surfaces that planning keeps away from may stand out of an obstacle itself [m]."""
    body = obstacle.body
    return body.error if isinstance(body, CylinderBody) else 0.0


def _from_room(bounds: FloatArray, segments: FloatArray) -> ObstacleGap:
    """Distances from the sides of the room, negative by how far a segment reaches out of it.

    The distance from a side is linear along a segment, so that its ends tell the least.
    """
    inside = np.minimum(segments - bounds[0], bounds[1] - segments).min(axis=2)
    end = np.argmin(inside, axis=1)
    number = np.arange(len(segments))
    gaps = inside[number, end]
    return ObstacleGap(ROOM_NAME, gaps, segments[number, end], outside=bool(gaps.min() < 0.0))


def contact_at_space_poses(problem: SpaceProblem) -> Iterator[Finding]:
    """Every obstacle that the arm touches in a pose of the problem, deepest first, and where it touches itself."""
    gaps = ObstacleGaps(problem.workspace)
    for pose in whole_space_poses(problem):
        yield from sorted(_walls_touched(problem, gaps, pose), key=lambda finding: -(finding.measured or 0.0))
        yield from _self_touched(problem.arm, pose)


def contact_at_space_tips(problem: SpaceProblem) -> Iterator[Finding]:
    """Every obstacle that the tip touches at a goal of its own; deepest first."""
    gaps = ObstacleGaps(problem.workspace)
    for place in space_tip_places(problem):
        yield from sorted(_tip_blocked(problem, gaps, place), key=lambda finding: -(finding.measured or 0.0))


def overlap_missed(arm: Arm) -> float:
    """Overlap that counts as touching in a proof [m]: what touches is not hit, and rounding is not contact."""
    return DEFAULT_DIAGNOSIS.passages.touching * arm.length


def _touching(gaps: ObstacleGaps, segments: FloatArray, need: float) -> Iterator[ObstacleGap]:
    """The obstacles that are nearer to some segment than is needed."""
    # One look at all surfaces at once: mostly there is nothing near, and no obstacle is looked at by itself.
    nearest = gaps.whole.distances(segments, need)
    if float(nearest.min()) >= need - ROUNDING and deepest_enclosure(gaps.workspace, segments[:, 1]) is None:
        return
    for found in gaps.of(segments, need):
        if float(found.gaps.min()) < need - ROUNDING:
            yield found


def _walls_touched(problem: SpaceProblem, gaps: ObstacleGaps, pose: WholeSpacePose) -> Iterator[Finding]:
    """Every obstacle that a pose touches, at the link that is deepest in it."""
    arm = problem.arm
    first, segments = arm.exposed_links(arm.joint_positions_at(pose.q))
    if not len(segments):
        return
    need = arm.radius + problem.workspace.clearance
    for found in _touching(gaps, segments, need):
        k = int(np.argmin(found.gaps))
        touch = _touch(problem, pose.name, pose.key, f"link {first + k + 1}", found, k, 0.0)
        lacking = need - found.gaps - found.error - pose.link_play(arm)[first:]
        yield replace(touch, proved=bool(np.max(lacking) > overlap_missed(arm)))


def _tip_blocked(problem: SpaceProblem, gaps: ObstacleGaps, place: SpaceTipPlace) -> Iterator[Finding]:
    """Obstacles that leave the tip, or with a direction the last link, no room within the tolerances."""
    arm = problem.arm
    tolerances = place.tolerances
    if arm.mount_length >= arm.length:
        return
    tip = place.goal.position
    play = tolerances.position
    what = "the tip"
    back = np.zeros(3)
    if place.goal.direction is not None:
        visible = min(arm.link_length, arm.length - arm.mount_length)
        back = visible * place.goal.direction / np.linalg.norm(place.goal.direction)
        what = f"link {arm.links}"
        # The last link may be shifted by one tolerance and turned about the tip by the other.
        play += visible * tolerances.heading
    body = np.stack((tip - back, tip))[None]
    need = arm.radius + problem.workspace.clearance
    for found in _touching(gaps, body, need):
        if found.gaps[0] + found.error + play - need < -overlap_missed(arm):
            yield _touch(problem, place.name, place.key, what, found, 0, play)


def _touch(problem: SpaceProblem, name: str, key: str, what: str, found: ObstacleGap, k: int, play: float) -> Finding:
    """One contact: the gap from axis to obstacle, the arm's radius and the clearance asked for."""
    clearance = problem.workspace.clearance
    gap = float(found.gaps[k])
    place = found.places[k]
    free = problem.arm.radius - gap
    if found.outside and gap < 0.0:
        how = f"{what} is {short_length(-gap)} outside the '{found.name}' at {at(place)}"
    elif gap < -problem.arm.radius:
        how = f"{what} is {short_length(-gap)} deep inside '{found.name}' at {at(place)}"
    elif free > 0.0:
        how = f"{what} overlaps '{found.name}' by {short_length(free)} at {at(place)}"
    else:
        near = gap_words(-free)
        how = f"{what} comes within {near} of '{found.name}' at {at(place)}, the clearance is {short_length(clearance)}"
    return contact_finding(problem, key, f"{name} is in contact: {how}", place, found.name, gap, play)


def _self_touched(arm: Arm, pose: WholeSpacePose) -> Iterator[Finding]:
    """The two distant links that overlap most."""
    i, j = arm.self_pairs
    if len(i) == 0:
        return
    points = arm.joint_positions_at(pose.q)
    _, _, distances, _ = segment_distances(points[i], points[i + 1], points[j], points[j + 1])
    k = int(np.argmin(distances))
    overlap = 2.0 * arm.radius - float(distances[k])
    if overlap <= ROUNDING:
        return
    play = pose.link_play(arm)
    yield Finding(
        "contact",
        f"{pose.key}: {pose.name} is in contact: links {i[k] + 1} and {j[k] + 1} overlap by {short_length(overlap)}",
        proved=bool(overlap > play[i[k]] + play[j[k]] + overlap_missed(arm)),
        key=pose.key,
        place=point(points[i[k]]),
        measured=overlap,
        allowed=0.0,
        bounds={"arm.radius": 0.5 * float(distances[k])} if distances[k] > 0.0 else {},
    )


def strong_enough_in_space(problem: SpaceProblem) -> Iterator[Finding]:
    """Poses that some joint cannot hold."""
    torque = problem.limits.torque
    if torque is None:
        return
    arm = problem.arm
    model = InverseDynamics(arm, problem.simulation.gravity)
    for pose in whole_space_poses(problem):
        # At rest, inverse dynamics gives what gravity asks of every joint.
        angles = revolute_angles(arm, pose.q[: 2 * arm.links])
        load = np.abs(model(angles, np.zeros_like(angles), np.zeros_like(angles)))
        number = int(np.argmax(load / torque))
        if load[number] > torque[number]:
            where = f"{pose.key}: at {pose.name} {joint_words(arm, number)}"
            proved = bool(np.any(load - _lighter(problem, pose) > torque))
            yield replace(overloaded(problem, where, number, float(load[number])), proved=proved)


def _lighter(problem: SpaceProblem, pose: WholeSpacePose) -> FloatArray:
    """By how much the tolerances of a pose can lower each revolute's load, at most, shape (3 links,) [N m]."""
    arm = problem.arm
    play = pose.link_play(arm)
    if not play.any():
        return np.zeros(3 * arm.links)
    # Beside the play the joint's axes turn: of a moment M they feel another share, by M times the angle at most.
    lever = arm.link_length * (arm.links - np.arange(arm.links))
    turned = carried_weights(problem) * lever * pose.turn_play(arm)
    return np.repeat(lighter_by_play(problem, play) + turned, 3)


SpaceCheck = Callable[[SpaceProblem], Iterator[Finding]]
AT_ONCE_IN_SPACE: tuple[SpaceCheck, ...] = (
    contact_at_space_poses,
    contact_at_space_tips,
    within_space_joint_limits,
    within_space_reach,
    supple_enough_in_space,
    strong_enough_in_space,
)
"""Checks that cost next to nothing."""
FIXED_BASE_IN_SPACE: frozenset[SpaceCheck] = frozenset((strong_enough_in_space,))
"""Checks whose proofs hold for a base that stands still: what a guide tube bears no joint has to."""


def found_in_space(problem: SpaceProblem, checks: tuple[SpaceCheck, ...]) -> tuple[Finding, ...]:
    """What some checks find, in their order.

    Args:
        problem: what was asked.
        checks: which ones.
    """
    fixed = not problem.arm.base_axes
    applicable = [check for check in checks if fixed or check not in FIXED_BASE_IN_SPACE]
    return tuple(finding for check in applicable for finding in check(problem))
