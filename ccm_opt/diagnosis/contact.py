"""Whether an arm can be at its start and goals: contacts, and torques that hold it."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.length_words import place as at
from ccm_opt.core.length_words import short_length
from ccm_opt.core.polyline import unit_vector
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS
from ccm_opt.diagnosis.keyed_poses import TipPlace, WholePose, tip_places, whole_poses
from ccm_opt.diagnosis.ranking import point
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.errors import Finding
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import AnyProblem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import joint_names, revolute_angles
from ccm_opt.scene.workspace import BOUNDARY_NAME, Obstacle


def contact_finding(
    problem: AnyProblem, key: str, message: str, where: FloatArray, obstacle: str, gap: float, play: float
) -> Finding:
    """One contact, with the radius and the clearance that would just end it.

    Args:
        problem: what was asked.
        key: of the pose in the problem file.
        message: what touches what, behind the key.
        where: the place, shape (d,) [m].
        obstacle: its name.
        gap: from the axis of the arm to the obstacle, less than 0 inside it [m].
        play: by how much tolerances may widen it [m].
    """
    radius = problem.arm.radius
    clearance = problem.workspace.clearance
    bounds = {}
    if (thinnest := gap + play - clearance) > 0.0:
        bounds["arm.radius"] = thinnest
    if (nearest := gap + play - radius) >= 0.0 and clearance > 0.0:
        bounds["workspace.clearance"] = nearest
    return Finding(
        "contact",
        f"{key}: {message}",
        key=key,
        place=point(where),
        measured=radius + clearance - gap,
        allowed=play,
        obstacles=(obstacle,),
        bounds=bounds,
    )


def gap_words(gap: float) -> str:
    """A gap in words [m]; what rounding leaves of one is none that a length tells anything of."""
    return short_length(gap) if gap > ROUNDING else "a hair"


def contact_at_poses(problem: Problem) -> Iterator[Finding]:
    """Every wall that the arm touches in a pose of the problem, deepest first, and where it touches itself."""
    for pose in whole_poses(problem):
        yield from sorted(_walls_touched(problem, pose), key=lambda finding: -(finding.measured or 0.0))
        yield from _self_touched(problem.arm, pose)


def contact_at_tips(problem: Problem) -> Iterator[Finding]:
    """Every wall that the tip touches at a goal of its own; deepest first."""
    for place in tip_places(problem):
        yield from sorted(_tip_blocked(problem, place), key=lambda finding: -(finding.measured or 0.0))


def contact_missed(arm: Arm) -> float:
    """Overlap that counts as touching in a proof [m]: what touches is not hit, and rounding is not contact."""
    return DEFAULT_DIAGNOSIS.passages.touching * arm.length


def axis_gap(wall: Obstacle, bodies: shapely.Geometry, room: shapely.Polygon) -> float:
    """Distance from a wall to the axis of a body [m]; negative by how deep the axis is inside."""
    if wall.name == BOUNDARY_NAME:
        # The boundary is a wall with its body outside: depth is measured there.
        outside = shapely.difference(bodies, room)
        depth = _farthest(outside, room.exterior)
        return -depth if depth > 0.0 else float(shapely.distance(bodies, wall.core))
    distance = float(shapely.distance(bodies, wall.core))
    if distance > 0.0 or not isinstance(wall.core, shapely.Polygon):
        return distance - wall.rounding
    # Distance says nothing inside a polygon: what counts there is how deep the axis is.
    return -_farthest(shapely.intersection(bodies, wall.core), wall.core.boundary)


def tip_has_room(problem: Problem, goal: FloatArray, tolerance: float) -> bool:
    """Whether the tip fits somewhere within the tolerance of a goal (2,) [m]."""
    need = problem.arm.radius + problem.workspace.clearance - tolerance
    tip = shapely.Point(goal)
    gaps = (axis_gap(wall, tip, problem.workspace.boundary) for wall in problem.workspace.walls)
    return all(gap >= need - ROUNDING for gap in gaps)


def _farthest(body: shapely.Geometry, edge: shapely.Geometry) -> float:
    """The largest distance of a body's corners and middles from an edge [m]; 0 for nothing."""
    # Every 2 mm along the body: depths between these points are hardly deeper.
    points = shapely.get_coordinates(shapely.segmentize(body, 2e-3))
    return float(np.max(shapely.distance(shapely.points(points), edge), initial=0.0))


def _walls_touched(problem: Problem, pose: WholePose) -> Iterator[Finding]:
    """Every wall that a pose touches, at the link that is deepest in it."""
    arm = problem.arm
    workspace = problem.workspace
    first, links = free_links(arm, arm.joint_positions(pose.headings, pose.feed))
    if not links:
        return
    need = arm.radius + workspace.clearance
    whole = shapely.MultiLineString(links)
    for wall in workspace.walls:
        if axis_gap(wall, whole, workspace.boundary) - need >= -ROUNDING:
            continue
        gaps = [axis_gap(wall, link, workspace.boundary) for link in links]
        # One finding a wall: the link that is deepest in it. A goal's tolerances may let some links out, not all.
        k = int(np.argmin(gaps))
        touch = _touch(problem, pose.name, pose.key, f"link {first + k + 1}", wall, gaps[k], links[k], 0.0)
        lacking = need - np.array(gaps) - pose.link_play(arm)[first:]
        yield replace(touch, proved=bool(np.max(lacking) > contact_missed(arm)))


def free_links(arm: Arm, points: FloatArray) -> tuple[int, list[shapely.LineString]]:
    """Index of the first link beyond the mount, and the axes of the links from there, the mount cut off."""
    first, share = arm.mount_end
    if share > 1.0 - 1e-9:  # the whole arm is mount
        return arm.links, []
    cut = points[first] + share * (points[first + 1] - points[first])
    corners = np.vstack((cut, points[first + 1 :]))
    return first, [shapely.LineString(corners[k : k + 2]) for k in range(len(corners) - 1)]


def _tip_blocked(problem: Problem, place: TipPlace) -> Iterator[Finding]:
    """Walls that leave the tip, or with a heading the last link, no room within the tolerances."""
    arm = problem.arm
    tolerances = place.tolerances
    if arm.mount_length >= arm.length:
        return
    play = tolerances.position
    what = "the tip"
    body: shapely.Geometry = shapely.Point(place.goal.position)
    if place.goal.heading is not None:
        visible = min(arm.link_length, arm.length - arm.mount_length)
        back = visible * unit_vector(place.goal.heading)
        body = shapely.LineString([place.goal.position - back, place.goal.position])
        what = f"link {arm.links}"
        # The last link may be shifted by one tolerance and turned about the tip by the other.
        play += arm.link_length * tolerances.heading
    need = arm.radius + problem.workspace.clearance
    for wall in problem.workspace.walls:
        gap = axis_gap(wall, body, problem.workspace.boundary)
        if gap + play - need < -contact_missed(arm):
            yield _touch(problem, place.name, place.key, what, wall, gap, body, play)


def _touch(
    problem: Problem,
    name: str,
    key: str,
    what: str,
    wall: Obstacle,
    gap: float,
    body: shapely.Geometry,
    play: float,
) -> Finding:
    """One contact: the gap from axis to wall, the arm's radius and the clearance asked for."""
    clearance = problem.workspace.clearance
    free = problem.arm.radius - gap
    line = shapely.shortest_line(body, wall.core)
    where = shapely.get_coordinates(line)[0]
    if wall.name == BOUNDARY_NAME and gap < 0.0:
        where = _outermost(body, problem.workspace.boundary)
        how = f"{what} is {short_length(-gap)} outside the '{wall.name}' at {at(where)}"
    elif free > 0.0:
        how = f"{what} overlaps '{wall.name}' by {short_length(free)}"
    else:
        near = gap_words(-free)
        how = f"{what} comes within {near} of '{wall.name}', the clearance is {short_length(clearance)}"
    return contact_finding(problem, key, f"{name} is in contact: {how}", where, wall.name, gap, play)


def _outermost(body: shapely.Geometry, room: shapely.Polygon) -> FloatArray:
    """The corner of a body that is farthest outside the room, shape (2,) [m]."""
    corners = shapely.get_coordinates(body)
    return np.asarray(corners[np.argmax(shapely.distance(shapely.points(corners), room))])


def _self_touched(arm: Arm, pose: WholePose) -> Iterator[Finding]:
    """The two distant links that overlap most."""
    i, j = arm.self_pairs
    if len(i) == 0:
        return
    points = arm.joint_positions(pose.headings, pose.feed)
    links = np.array([shapely.LineString(points[k : k + 2]) for k in range(arm.links)], dtype=object)
    distances = shapely.distance(links[i], links[j])
    k = int(np.argmin(distances))
    overlap = 2.0 * arm.radius - float(distances[k])
    if overlap <= ROUNDING and distances[k] > 0.0:
        return
    play = pose.link_play(arm)
    crossing = distances[k] == 0.0 and not play.any()
    yield Finding(
        "contact",
        f"{pose.key}: {pose.name} is in contact: links {i[k] + 1} and {j[k] + 1} overlap by {short_length(overlap)}",
        proved=bool(crossing or overlap > play[i[k]] + play[j[k]] + contact_missed(arm)),
        key=pose.key,
        place=point(points[i[k]]),
        measured=overlap,
        allowed=0.0,
        bounds={"arm.radius": 0.5 * float(distances[k])} if distances[k] > 0.0 else {},
    )


def strong_enough(problem: Problem) -> Iterator[Finding]:
    """Poses that some joint cannot hold; only for a base that stands still."""
    torque = problem.limits.torque
    if torque is None:
        return
    model = InverseDynamics(problem.arm, problem.simulation.gravity)
    for pose in whole_poses(problem):
        # At rest, inverse dynamics gives what gravity asks of every joint.
        angles = revolute_angles(problem.arm, problem.arm.bends(pose.headings))
        load = np.abs(model(angles, np.zeros_like(angles), np.zeros_like(angles)))
        number = int(np.argmax(load / torque))
        if load[number] > torque[number]:
            where = f"{pose.key}: at {pose.name} {joint_words(problem.arm, number)}"
            proved = bool(np.any(load - _lighter(problem, pose) > torque))
            yield replace(overloaded(problem, where, number, float(load[number])), proved=proved)


def _lighter(problem: Problem, pose: WholePose) -> FloatArray:
    """By how much the tolerances of a pose can lower each revolute's load, at most, shape (3 links,) [N m]."""
    return np.repeat(lighter_by_play(problem, pose.link_play(problem.arm)), 3)


def lighter_by_play(problem: AnyProblem, play: FloatArray) -> FloatArray:
    """By how much the load of each joint may be lower where joints are off their places, at most, shape (links,) [N m].

    Args:
        problem: with the arm and gravity.
        play: of each joint, shape (links,) [m].
    """
    # Every weight beyond a joint may come nearer by its own play and by the joint's.
    weights = _weights(problem)
    moved = np.append(play, play[-1])
    beyond = np.cumsum((weights * moved)[::-1])[::-1][: problem.arm.links]
    return np.asarray(beyond + carried_weights(problem) * play)


def carried_weights(problem: AnyProblem) -> FloatArray:
    """What hangs on each joint, the payload too, shape (links,) [N]."""
    return np.asarray(np.cumsum(_weights(problem)[::-1])[::-1][: problem.arm.links])


def _weights(problem: AnyProblem) -> FloatArray:
    """Of the links and of the payload, shape (links + 1,) [N]."""
    arm = problem.arm
    return float(np.linalg.norm(problem.simulation.gravity)) * np.append(arm.masses, arm.payload)


def overloaded(problem: AnyProblem, where: str, number: int, load: float) -> Finding:
    """A joint that cannot hold the arm in one pose, which by itself proves nothing: its torque against its limit.

    Args:
        problem: what was asked.
        where: the beginning of the reason, up to the joint.
        number: of the revolute.
        load: torque that it needs [N m].
    """
    limits = problem.limits.torque
    limit = np.inf if limits is None else float(limits[number])
    share = load / limit
    return Finding(
        "torque",
        f"{where} needs {load:.4g} N m to hold the arm still, its torque limit is {limit:.4g} N m",
        proved=False,
        key="limits.torque",
        measured=load,
        allowed=limit,
        unit="N m",
        bounds={"limits.torque": share, "arm.link_mass": 1.0 / share},
    )


def joint_words(arm: Arm, number: int) -> str:
    """A revolute in words: its ball, counted from 1, and its name."""
    return f"joint {number // 3 + 1} ({joint_names(arm)[number]})"
