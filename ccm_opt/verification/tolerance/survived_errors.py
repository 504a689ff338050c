"""Errors that a planar plan survives.

Where the room about a corner spans less than half a turn, as in the corners of a room seen from inside, a link whose
axis is nearest to the corner in its own middle is nearer still to one of the two edges that meet there: the one at
less than a right angle to the shortest line. The nearest points of that edge and the link involve another end of
either, so a first touch is never at such a corner alone.
"""

from collections.abc import Callable

import numpy as np
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace
from ccm_opt.solution import JointTrajectory, SurvivedError
from ccm_opt.verification.bisection import Pairs
from ccm_opt.verification.link_motion import ChainMotion, Nodes
from ccm_opt.verification.selfcollision import first_distant
from ccm_opt.verification.tolerance.chain_cases import ChainCases, worst_errors
from ccm_opt.verification.tolerance.error_model import (
    DEFAULT_TOLERANCE,
    ErrorModel,
    ToleranceSettings,
    base_heading_error,
    base_position_error,
    joint_errors,
    link_length_errors,
    wall_errors,
)
from ccm_opt.verification.tolerance.largest_error import LargestError, Limiting, LinkCases
from ccm_opt.verification.tolerance.moving_chain import MovingChain
from ccm_opt.verification.tolerance.wall_cases import WallCases
from ccm_opt.verification.wall_clearance import exposed_starts
from ccm_opt.verification.wall_edges import WallEdges, wall_edges


def hidden_corners(workspace: Workspace) -> BoolArray:
    """Which ends of the walls' edges are such corners, in the order of ``wall_edges``, shape (E, 2)."""
    parts = [_of_part(part) for wall in workspace.obstacles for part in shapely.get_parts(wall.core)]
    parts.append(_of_ring(workspace.boundary.exterior, room_inside=True))
    return np.concatenate(parts)


def _of_part(part: shapely.Geometry) -> BoolArray:
    if isinstance(part, shapely.Polygon):
        holes = [_of_ring(ring, room_inside=True) for ring in part.interiors]
        return np.concatenate([_of_ring(part.exterior, room_inside=False), *holes])
    # The room is on both sides of a line, and all about a point.
    edges = max(len(shapely.get_coordinates(part)) - 1, 1)
    return np.zeros((edges, 2), dtype=bool)


def _of_ring(ring: shapely.LinearRing, *, room_inside: bool) -> BoolArray:
    points = shapely.get_coordinates(ring)
    after = np.diff(points, axis=0)
    before = np.roll(after, 1, axis=0)
    left = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    inwards = left if shapely.is_ccw(ring) else -left
    at_start = inwards > 0.0 if room_inside else inwards < 0.0
    return np.stack((at_start, np.roll(at_start, -1)), axis=1)


MODELS: tuple[Callable[[Arm], ErrorModel], ...] = (
    joint_errors,
    link_length_errors,
    base_heading_error,
    base_position_error,
    wall_errors,
)
"""Everything that may be wrong with the geometry."""

_TINY = 1e-300
_DIGITS = 3
"""Digits of the shares of the worst errors that are worth telling."""


def survived_errors(
    arm: Arm, workspace: Workspace, trajectory: JointTrajectory, settings: ToleranceSettings = DEFAULT_TOLERANCE
) -> tuple[SurvivedError, ...]:
    """The largest errors of every kind, one kind at a time; arguments as for ``survived_error``."""
    return tuple(survived_error(arm, workspace, trajectory, make(arm), settings) for make in MODELS)


def survived_error(
    arm: Arm,
    workspace: Workspace,
    trajectory: JointTrajectory,
    model: ErrorModel,
    settings: ToleranceSettings = DEFAULT_TOLERANCE,
    most: float = np.inf,
) -> SurvivedError:
    """The largest error of one kind with which every motion keeps clear, certified at all times.

    Every motion whose coordinates are within the error of the planned ones at all times keeps the clearance from every
    wall, beyond the mount, and two radii between distant links where the arm has to. Joints that a guide tube holds
    straight have no error.

    Args:
        arm: the arm.
        workspace: the room, its obstacles and the clearance.
        trajectory: the plan, linear between its samples.
        model: what may be wrong.
        settings: how closely the error is sought.
        most: larger errors are not looked at [unit]; what is survived is told as this.
    """
    motion = ChainMotion(arm, trajectory.time, trajectory.positions)
    edges = wall_edges(workspace)
    search = LargestError(min(most, _largest(arm, model, settings)), settings)
    coarse = MovingChain.in_strides(motion, model, settings.stride * arm.link_length)
    fine = MovingChain.through_all(motion, model)

    kinds: list[Callable[[MovingChain], WallCases | LinkCases]] = []
    if np.any(exposed_starts(arm) < 1.0):
        hidden = hidden_corners(workspace)
        kinds.append(lambda chain: WallCases(chain, edges, workspace.clearance, hidden))
    if model.with_itself and arm.self_collision and first_distant(arm) < arm.links:
        kinds.append(LinkCases)
    # A good upper end first: it decides how far anything has to look.
    for kind in kinds:
        search.tighten(kind(fine).nearest(settings.probes))
    for kind in kinds:
        _prove(search, kind(coarse), kind(fine))
    return _named(model, search.certified, search.limiting, fine, edges)


def _largest(arm: Arm, model: ErrorModel, settings: ToleranceSettings) -> float:
    """Errors above this are not looked at [unit]."""
    turned = float(np.sum(model.turns))
    return settings.largest_turn / turned if turned > 0.0 else settings.largest_length * arm.length


def _prove(search: LargestError, coarse: WallCases | LinkCases, fine: WallCases | LinkCases) -> None:
    """Prove all cases over strides of the motion, and those that are left over at its samples."""
    pairs = coarse.within(search.upper)
    left = search.undecided(coarse.cases(pairs), of_motion=False)
    search.prove(fine.cases(_at_samples(left, coarse.chain.at)))


def _at_samples(cases: ChainCases, at: IntArray) -> Pairs:
    """The pairs of cases over strides, for every interval between samples in these strides."""
    pairs = np.unique(np.stack((cases.interval, cases.link, cases.other), axis=1), axis=0)
    first = at[pairs[:, 0]]
    counts = at[pairs[:, 0] + 1] - first
    row = np.repeat(np.arange(len(pairs)), counts)
    within = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    return Pairs(first[row] + within, pairs[row, 1], pairs[row, 2])


def _named(
    model: ErrorModel, size: float, limiting: Limiting | None, chain: MovingChain, edges: WallEdges
) -> SurvivedError:
    if limiting is None:
        return SurvivedError(model.name, size, model.unit, "nothing; larger errors are not looked at", limited=False)
    case = limiting.case
    time = chain.motion.time
    k = int(case.interval[0])
    when = float(time[k] + case.stretch[0, 0] * (time[k + 1] - time[k]))
    link = int(case.link[0])
    other = int(case.other[0])
    body = f"link {other + 1}" if case.with_link[0] else repr(edges.names[edges.owner[other]])
    where = f"link {link + 1} to {body} at t = {when:.4f} s"
    worst = _worst_shares(limiting, chain.arm.links) if np.any(model.turns[1:]) else ()
    place = _place(case, chain, edges)
    return SurvivedError(model.name, size, model.unit, where, when, link + 1, worst, place)


def _place(case: ChainCases, chain: MovingChain, edges: WallEdges) -> tuple[float, ...]:
    """Half-way between the link of a case and what is nearest to it, shape (2,) [m]."""
    node = Nodes(case.interval, case.stretch[:, 0], np.zeros(1))
    points = chain.motion.poses(node)[0]
    link = int(case.link[0])
    other = int(case.other[0])
    ends = points[other : other + 2] if case.with_link[0] else np.stack((edges.start[other], edges.end[other]))
    line = shapely.shortest_line(shapely.LineString(points[link : link + 2]), shapely.LineString(ends))
    return tuple(float(value) for value in shapely.get_coordinates(line).mean(axis=0))


def _worst_shares(limiting: Limiting, links: int) -> tuple[float, ...]:
    """Errors of the joints, as shares of the largest, that bring the limiting link near, shape (links,)."""
    case = limiting.case
    widths = limiting.error * case.turns
    errors = worst_errors(case.lengths[:, 0], case.angles[:, 0], widths, np.array([limiting.direction]))[0]
    shares = np.zeros(links + 1)
    used = case.joints[0] > 0
    shares[case.joints[0, used]] = case.sense[0] * errors[used] / max(limiting.error, _TINY)
    # Nought has no sign.
    return tuple(float(share) + 0.0 for share in np.round(shares[1:], _DIGITS))


def worst_motion(trajectory: JointTrajectory, error: SurvivedError, size: float) -> FloatArray:
    """Bends of a motion whose joints are off all the time as leads to a touch soonest, shape (T, links) [rad].

    Args:
        trajectory: the plan.
        error: what its joints survive.
        size: of the error of every joint [rad].
    """
    return np.asarray(trajectory.bend_angles + size * np.array(error.worst))
