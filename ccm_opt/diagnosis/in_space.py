"""What explains failures in space."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.length_words import in_unit, long_length, short_length
from ccm_opt.core.length_words import place as at
from ccm_opt.diagnosis.axis_ways import AxisWays, free_depth, way_length
from ccm_opt.diagnosis.contact_in_space import AT_ONCE_IN_SPACE, SpaceCheck, contact_at_space_tips, found_in_space
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, MovedSpaceGoalSettings, TightnessSettings
from ccm_opt.diagnosis.in_plane import unit_hints_in_space
from ccm_opt.diagnosis.keyed_poses import SpaceTipPlace, space_tip_places, whole_space_poses
from ccm_opt.diagnosis.moved_goal import about_the_goal, moved_position
from ccm_opt.diagnosis.parameters import Parameter, WholeChange
from ccm_opt.diagnosis.ranking import point
from ccm_opt.diagnosis.reach import tight_turn
from ccm_opt.diagnosis.reach_in_space import angle_between, most_turn, supple_enough_in_space, within_space_reach
from ccm_opt.diagnosis.relaxation import Knowledge, heading_may_mend
from ccm_opt.diagnosis.ways_in_space import between, closed_in_space, wide_and_short_enough_in_space
from ccm_opt.errors import Finding
from ccm_opt.planning.space_task import reach_box
from ccm_opt.problem import TipGoal
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import ROOM_NAME

_CELLS = 20_000
"""Of each of two grids, one about the goal, one where the arm can be. Taste."""
_APART = 0.2
"""Places are told when they are this share of their distance from the goal off the ones before. Taste."""
_MOST_PLACES = 200
"""That are looked at. Taste: some 5 ms each."""

_MOST_WAYS = 3
"""Of them to which a way is looked for. Taste: some 0.3 s each."""

NECESSARY_IN_SPACE: tuple[SpaceCheck, ...] = (*AT_ONCE_IN_SPACE, wide_and_short_enough_in_space)
"""All necessary checks, the most elementary first."""


def failed_in_space(problem: SpaceProblem) -> tuple[Finding, ...]:
    """What all necessary checks find, in their order."""
    return found_in_space(problem, NECESSARY_IN_SPACE)


def moved_space_goals(
    problem: SpaceProblem,
    findings: tuple[Finding, ...],
    until: Deadline,
    settings: MovedSpaceGoalSettings = DEFAULT_DIAGNOSIS.moved_space_goal,
) -> Iterator[Parameter]:
    """By how far, and which way, the goal's position may have to be moved; at most one.

    Args:
        problem: what was asked; nothing where its goal is for the whole arm, or the last of several.
        findings: what is proved.
        until: when places are looked at no longer.
        settings: numbers.
    """
    goal = problem.goal
    if not about_the_goal(findings) or not isinstance(goal, TipGoal) or problem.stops:
        return
    place = _nearest_place(problem, goal, until, settings)
    if place is not None:
        yield _position(problem, goal, place, settings)


def _nearest_place(
    problem: SpaceProblem, goal: TipGoal, until: Deadline, settings: MovedSpaceGoalSettings
) -> FloatArray | None:
    """The nearest place (3,) of some grids that no necessary check refuses; None where none is found."""
    looked = 0
    ways = 0
    for place in _by_distance(problem, goal, settings):
        if until.passed() or looked >= _MOST_PLACES or ways >= _MOST_WAYS:
            return None
        looked += 1
        moved = replace(problem, goal=replace(goal, position=place))
        if any(finding.proved for check in _QUICK for finding in check(moved)):
            continue
        ways += 1
        asked = SpaceTipPlace("goal", "goal.position", replace(goal, position=place), problem.tolerances)
        if AxisWays(moved, asked).answer != "closed":
            return place
    return None


_QUICK = (within_space_reach, contact_at_space_tips, supple_enough_in_space)
"""What is looked at first at every place."""


def _by_distance(problem: SpaceProblem, goal: TipGoal, settings: MovedSpaceGoalSettings) -> Iterator[FloatArray]:
    """Places with room for the tip, those nearest to the goal first, each well off the ones before it."""
    arm = problem.arm
    need = arm.radius + problem.workspace.clearance
    tree = SurfaceTree.of(problem.workspace.soup)
    far = reach_box(arm, problem.workspace.bounds)
    near = goal.position + settings.near * max(need, 0.01 * arm.length) * np.array([[-1.0], [1.0]])
    near = np.clip(near, far[0], far[1])
    # About a goal out of reach there is nothing that is within it.
    boxes = (near, far) if np.all(near[1] > near[0]) else (far,)
    places = np.concatenate([_roomy(tree, box, _CELLS, need) for box in boxes])
    # Where the arm is stretched out is the nearest place to a goal out of reach.
    low, high = arm.base_range
    base = arm.base + np.clip((goal.position - arm.base) @ arm.direction, low, high) * arm.direction * bool(
        arm.base_axes
    )
    away = goal.position - base
    distance = float(np.linalg.norm(away))
    if distance > settings.stretch * arm.length:
        places = np.concatenate(((base + settings.stretch * arm.length / distance * away)[None], places))
    reached = np.linalg.norm(places - base, axis=1) <= settings.stretch * arm.length
    places = places[reached]
    ordered = places[np.argsort(np.linalg.norm(places - goal.position, axis=1), kind="stable")]
    told: list[FloatArray] = []
    for place in ordered:
        apart = _APART * float(np.linalg.norm(place - goal.position))
        # Neighbours are mostly refused for one reason.
        if all(float(np.linalg.norm(place - other)) >= apart for other in told):
            told.append(place)
            yield place


def _roomy(tree: SurfaceTree, box: FloatArray, cells: int, need: float) -> FloatArray:
    """Middles of the cells of a grid over a box that keep a distance from all surfaces, shape (k, 3) [m]."""
    sides = box[1] - box[0]
    # A flat box has few cells rather than tiny ones.
    sides = np.maximum(sides, float(np.max(sides)) / cells ** (1.0 / 3.0))
    cell = float((np.prod(sides) / cells) ** (1.0 / 3.0))
    counts = np.maximum(np.ceil(sides / cell).astype(int), 1)
    first = box[0] + 0.5 * cell
    gaps = tree.grid(first, cell, (int(counts[0]), int(counts[1]), int(counts[2])), 2.0 * need + cell)
    return np.asarray(first + cell * np.argwhere(gaps > need))


def _position(problem: SpaceProblem, goal: TipGoal, place: FloatArray, settings: MovedSpaceGoalSettings) -> Parameter:
    """The goal's position moved towards a place, by a distance, and beyond it."""
    distance = float(np.linalg.norm(place - goal.position))
    # What lies far beyond a goal far away is no better for that.
    spread = min(distance, problem.arm.length)
    tried = [distance + step * spread for step in settings.steps]
    return moved_position(problem, goal, place, distance, tried)


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


DECIMALS = 4
"""Of a direction's components as they are told; a direction is off by a hundredth of a degree at most."""


def turned_direction(problem: SpaceProblem, end: FloatArray) -> Parameter | None:
    """The direction of a problem's goal, turned by an angle towards that in which the last link points in a pose.

    Args:
        problem: what was asked; nothing where its goal asks for no direction.
        end: a configuration with the tip at the goal, shape (c,) [rad, m].
    """
    goal = problem.goal
    if not isinstance(goal, TipGoal) or goal.direction is None:
        return None
    wanted = goal.direction / np.linalg.norm(goal.direction)
    taken = problem.arm.link_rotations(end)[-1, :, 0]
    whole = float(2.0 * np.arctan2(np.linalg.norm(taken - wanted), np.linalg.norm(taken + wanted)))
    if whole <= problem.tolerances.heading:
        return None
    across = _across(wanted, taken)

    def told(by: float) -> FloatArray:
        return np.asarray(np.round(np.cos(by) * wanted + np.sin(by) * across, DECIMALS))

    def turned(by: float) -> FloatArray:
        # As it is read from the file: what is told is what was solved.
        return np.asarray(told(by) / np.linalg.norm(told(by)))

    return Parameter(
        "goal.direction",
        +1,
        lambda _: 0.0,
        lambda p, by: replace(p, goal=replace(goal, direction=turned(by))),
        lambda _, by: f"goal.direction turned by {np.rad2deg(by):.4g}°, to {_in_file(told(by))}",
        lambda _: float(np.rad2deg(1.0)),
        whole=np.pi,
        tried=(whole,),
        paths_stay=False,
    )


def _across(wanted: FloatArray, taken: FloatArray) -> FloatArray:
    """The unit vector across one direction that lies on the way to another; any where they are opposite."""
    across = taken - (taken @ wanted) * wanted
    length = float(np.linalg.norm(across))
    if length > 1e-9:
        return np.asarray(across / length)
    axis = np.eye(3)[int(np.argmin(np.abs(wanted)))]
    side = np.cross(wanted, axis)
    return np.asarray(side / np.linalg.norm(side))


def _in_file(direction: FloatArray) -> str:
    """A direction as it is written in the problem's file."""
    return f"({', '.join(f'{float(component):.{DECIMALS}f}' for component in direction)})"


def wider_space_room(
    problem: SpaceProblem, findings: tuple[Finding, ...], spare: float = DEFAULT_DIAGNOSIS.trials.room_spare
) -> WholeChange | None:
    """The problem in bounds that hold its start and its goals; None where other things than a room's sides matter.

    Args:
        problem: what was asked.
        findings: what is proved.
        spare: room beyond radius and clearance, as a share of the arm's length.
    """
    bounds = problem.workspace.bounds
    of_room = all(finding.kind == "contact" and ROOM_NAME in finding.obstacles for finding in findings)
    if not findings or not of_room or bounds is None:
        return None
    need = problem.arm.radius + problem.workspace.clearance + spare * problem.arm.length
    points = _points(problem)
    step = 10.0 ** np.floor(np.log10(problem.arm.length) - 3.0)
    low = np.floor(np.minimum(points.min(axis=0) - need, bounds[0]) / step) * step
    high = np.ceil(np.maximum(points.max(axis=0) + need, bounds[1]) / step) * step
    wider = np.stack((low, high))
    # In the unit of the file, into which people copy them.
    unit = problem.length_unit
    corners = (", ".join(f"{in_unit(value, unit):.6g}" for value in corner.tolist()) for corner in wider)
    numbers = f"[{'], ['.join(corners)}]"
    return WholeChange(
        f"workspace.bounds = [{numbers}] {unit}",
        "workspace.bounds",
        numbers,
        lambda p: replace(p, workspace=replace(p.workspace, bounds=wider)),
    )


def _points(problem: SpaceProblem) -> FloatArray:
    """Joints and tips of all that a problem gives, shape (m, 3) [m]."""
    poses = [problem.arm.joint_positions_at(pose.q) for pose in whole_space_poses(problem)]
    tips = [place.goal.position[None] for place in space_tip_places(problem)]
    return np.concatenate([*poses, *tips])


def _hopeless(problem: SpaceProblem) -> bool:
    at_once = found_in_space(problem, AT_ONCE_IN_SPACE)
    return any(finding.proved for finding in at_once) or closed_in_space(problem)


def _left_out(problem: SpaceProblem, findings: tuple[Finding, ...]) -> Iterator[WholeChange]:
    """The goal's direction, where all that is known to stand in the way may be due to it, and places on the way."""
    goal = problem.goal
    if not isinstance(goal, TipGoal):
        return
    # Where nothing is known to stand in the way, few links may not be able to turn where there is little room.
    if goal.direction is not None and all(heading_may_mend(finding) for finding in findings):
        yield WholeChange(
            "goal.direction left out",
            "goal.direction",
            None,
            lambda p: replace(p, goal=replace(p.goal, direction=None)),
            part=turned_direction,
        )
    if goal.via and not any(finding.proved for finding in findings):
        yield WholeChange("goal.via left out", "goal.via", None, lambda p: replace(p, goal=replace(p.goal, via=())))


IN_SPACE = Knowledge(
    failed_in_space,
    _hopeless,
    tight_in_space,
    wider_space_room,
    moved_space_goals,
    _left_out,
    unit_hints_in_space,
    ROOM_NAME,
)
"""Of arms in space."""
