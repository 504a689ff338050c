"""An oracle for plans of arms of any layout that reads problem file and arrays itself and uses nothing of the package.

Keys of the file are read here, links are placed by scipy's rotations, and distances are coal's in space and shapely's
in the plane.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import coal
import numpy as np
import shapely
import shapely.affinity
import trimesh
from scipy.spatial.transform import Rotation

from ccm_opt.core.arrays import FloatArray

TRAVEL = 2e-3
"""No joint of the arm moves farther than this between two poses that are looked at [m]."""
TOUCH = 1e-5
"""Gap that may be missing, of arms as long as a metre: poses are not where the gap is least [m]."""
LOOK = 0.02
"""Gaps are not told apart beyond this [m]."""
Keys = Mapping[str, Any]
"""A table of a problem file, with lengths in metres."""


@dataclass(frozen=True, eq=False)
class FileArm:
    """The arm of a problem file.

    Attributes:
        table: the arm's table.
        space: whether it moves in space.
        folder: folder of the meshes of its bodies.
    """

    table: Keys
    space: bool
    folder: Path = Path()

    @property
    def sections(self) -> Sequence[Keys]:
        """Tables of the sections; of an arm of equal links, its own."""
        return self.table.get("sections", [self.table])  # type: ignore[no-any-return]

    @property
    def joints(self) -> int:
        """Number of the joints."""
        return len(self.lengths)

    @property
    def joint_places(self) -> FloatArray:
        """Arc lengths of the joints, shape (links,) [m]."""
        return self.places[:-1]

    def _each(self, value: Any) -> FloatArray:
        """Values of all links, shape (links,), from a function of each section and its number of links."""
        return np.concatenate([np.broadcast_to(value(row, row["links"]), row["links"]) for row in self.sections])

    @cached_property
    def lengths(self) -> FloatArray:
        """Length of each link, shape (links,) [m]."""
        return self._each(lambda row, _: row["link_length"])

    @cached_property
    def radii(self) -> FloatArray:
        """Radius of each link, shape (links,) [m]."""

        def radius(row: Keys, count: int) -> Any:
            if np.ndim(row["radius"]) == 0:
                return row["radius"]
            ends = np.linspace(row["radius"][0], row["radius"][1], count + 1)
            return np.maximum(ends[:-1], ends[1:])

        return self._each(radius)

    @cached_property
    def limits(self) -> FloatArray:
        """Limits of each joint's bends, in the plane both alike, shape (links, 2) [rad]."""

        def limits(row: Keys) -> FloatArray:
            free = ~np.isin(np.arange(1, row["links"] + 1), row.get("locked", ()))
            return free[:, None] * np.broadcast_to(np.array(row.get("joint_limit_deg", 60.0), dtype=float), 2)

        degrees = np.concatenate([limits(row) for row in self.sections])
        if degrees[0].any():
            degrees[0] = self.table.get("base_limit_deg", 360.0)
        return np.deg2rad(degrees)

    @cached_property
    def places(self) -> FloatArray:
        """Arc lengths of the joints and the tip, shape (links + 1,) [m]."""
        return np.concatenate(([0.0], np.cumsum(self.lengths)))

    @cached_property
    def base(self) -> tuple[FloatArray, FloatArray]:
        """Position of the base with all axes at zero [m], and its rotation in space or its heading in the plane."""
        base = self.table["base"]
        if not self.space:
            return np.array(base), np.array(np.deg2rad(self.table.get("base_heading_deg", 0.0)))
        ahead = np.array(base.get("direction", (1.0, 0.0, 0.0)))
        ahead = ahead / np.linalg.norm(ahead)
        up = np.array(base.get("up", (0.0, 0.0, 1.0)))
        up = up - (up @ ahead) * ahead
        up = up / np.linalg.norm(up)
        return np.array(base.get("position", (0.0, 0.0, 0.0))), np.column_stack((ahead, np.cross(up, ahead), up))

    @cached_property
    def bodies(self) -> list["FileBody"]:
        """Bodies on links, those of the tool last."""
        links = [(row["link"] - 1, row) for row in self.table.get("bodies", ())]
        links += [(len(self.lengths) - 1, self.table["tool"])] if "tool" in self.table else []
        read = partial(_solid, folder=self.folder) if self.space else _flat
        return [FileBody(k, *read(row), row) for k, rigid in links for row in rigid.get("bodies", ())]

    @cached_property
    def at_rest(self) -> tuple[FloatArray, Any]:
        """Joints and frames of the straight arm, as of one pose."""
        count = self.joints
        axes = len(self.table["base"].get("axes", ())) if self.space else 0
        return self.placed(np.zeros((1, count, 2) if self.space else (1, count)), np.zeros((1, axes)))

    def tips(self, points: FloatArray, frames: Any) -> FloatArray:
        """Return where goals are to be: the end of the last link or the tip of the tool, shape (T, d) [m]."""
        if "tool" not in self.table:
            return points[:, -1]
        tip = np.array(self.table["tool"].get("tip", np.zeros(points.shape[-1])), dtype=float)
        return self.fixed(len(self.lengths) - 1, points, frames, tip)

    def fixed(self, link: int, points: FloatArray, frames: Any, place: FloatArray) -> FloatArray:
        """Return where a place in the frame of a link, from its end, is in T poses, shape (T, d) [m]."""
        if self.space:
            return np.asarray(points[:, link + 1] + frames[link].apply(place))
        cos, sin = np.cos(frames[:, link]), np.sin(frames[:, link])
        turned = np.stack((cos * place[0] - sin * place[1], sin * place[0] + cos * place[1]), axis=-1)
        return np.asarray(points[:, link + 1] + turned)

    def placed(self, bends: FloatArray, axes: FloatArray) -> tuple[FloatArray, Any]:
        """Return joints and tip, shape (T, links + 1, d) [m], and the frames (links) or headings (T, links) of links.

        Args:
            bends: bends of the joints, shape (T, links) or (T, links, 2) [rad].
            axes: positions of the axes below the arm, shape (T, k) [m, rad].
        """
        count = len(bends)
        place, turn = self.base
        if not self.space:
            headings = turn + np.cumsum(bends, axis=1)
            steps = self.lengths[:, None] * np.stack((np.cos(headings), np.sin(headings)), axis=-1)
            feed = axes.sum(axis=1)[:, None] * np.array([np.cos(turn), np.sin(turn)])
            points = place + feed[:, None] + np.concatenate((np.zeros((count, 1, 2)), np.cumsum(steps, axis=1)), axis=1)
            return points, headings
        origin, frames = self._carried(axes)
        points = np.empty((count, len(self.lengths) + 1, 3))
        points[:, 0] = origin
        of_links = []
        for k, length in enumerate(self.lengths.tolist()):
            frames = frames * Rotation.from_euler("ZY", bends[:, k])
            points[:, k + 1] = points[:, k] + frames.apply([length, 0.0, 0.0])
            of_links.append(frames)
        return points, of_links

    def _carried(self, axes: FloatArray) -> tuple[FloatArray, Rotation]:
        """Return where axes carry the base: each moves what is beyond it about where it is with all axes at zero."""
        place, turn = self.base
        count = len(axes)
        frames = Rotation.from_matrix(np.broadcast_to(turn, (count, 3, 3)))
        rows = self.table["base"].get("axes", ())
        if not rows:
            return place + axes.sum(axis=1)[:, None] * turn[:, 0], frames
        origin = np.broadcast_to(place, (count, 3))
        for row, values in reversed(list(zip(rows, axes.T, strict=True))):
            axis = np.array(row["axis"], dtype=float)
            axis /= np.linalg.norm(axis)
            if row["kind"] == "prismatic":
                origin = origin + values[:, None] * axis
                continue
            point, turned = np.array(row.get("position", place)), Rotation.from_rotvec(values[:, None] * axis)
            origin, frames = point + turned.apply(origin - point), turned * frames
        return origin, frames

    @cached_property
    def mounted(self) -> FloatArray:
        """Share of each link that belongs to the mount, shape (links,)."""
        moves = self.space and "axes" in self.table["base"]
        mount = 0.0 if moves else self.table.get("mount_length", self.radii[0])
        return np.asarray(np.clip((mount - self.places[:-1]) / self.lengths + 1e-9, 0.0, 1.0))

    def exposed(self, points: FloatArray) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Yield each link beyond the mount with the two ends of its axis, each of shape (T, d) [m]."""
        for k, share in enumerate(self.mounted.tolist()):
            if share < 1.0 - 1e-8:
                yield k, points[:, k] + share * (points[:, k + 1] - points[:, k]), points[:, k + 1]

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Pairs of links with two links and half a turn of the thickest between them."""
        if not self.table.get("self_collision", True):
            return []
        count = len(self.lengths)
        return [
            (i, j)
            for i in range(count)
            for j in range(i + 3, count)
            if self.places[j] - self.places[i + 1] >= np.pi * self.radii[i : j + 1].max() - 1e-9 * self.lengths.mean()
        ]


@dataclass(frozen=True, eq=False)
class FileBody:
    """A body on a link, as the file gives it: a solid of coal in space, a shape of shapely in the plane.

    Attributes:
        link: index of the link.
        shape: the shape, in the plane in the frame of the link from its end.
        place: where the solid is in that frame; None in the plane.
        rounding: distance by which a planar shape is grown [m].
        row: its table.
    """

    link: int
    shape: Any
    place: Any
    rounding: float
    row: Keys

    @cached_property
    def beyond(self) -> float:
        """How far capsules that cover the body may reach beyond it [m]."""
        if "mesh" in self.row or "polygon" in self.row:
            return self.reach[1]
        if "box" not in self.row:
            return self.rounding + (self.row["cylinder"]["radius"] if "cylinder" in self.row else 0.0)
        sides = np.ptp(np.reshape(self.row["box"], (2, -1)), axis=0)
        return 0.5 * float(np.linalg.norm(sides))

    @cached_property
    def reach(self) -> tuple[FloatArray, float]:
        """Centre and radius of a ball about it, in the frame of the link [m]."""
        if self.place is None:
            centre = np.array(self.shape.centroid.coords[0])
            return centre, float(shapely.hausdorff_distance(self.shape, shapely.Point(centre))) + self.rounding
        self.shape.computeLocalAABB()
        return np.asarray(self.place.transform(self.shape.aabb_center)), float(self.shape.aabb_radius)

    def at(self, points: FloatArray, frames: Any, poses: Sequence[int]) -> list[Any]:
        """Return the solid's placements, or the shapes, in chosen poses."""
        end = points[:, self.link + 1]
        if self.place is not None:
            turns = frames[self.link].as_matrix()
            own = self.place
            return [
                coal.Transform3s(turns[k] @ own.getRotation(), end[k] + turns[k] @ own.getTranslation()) for k in poses
            ]
        found = []
        for k in poses:
            cos, sin = np.cos(frames[k, self.link]), np.sin(frames[k, self.link])
            found.append(shapely.affinity.affine_transform(self.shape, (cos, -sin, sin, cos, *end[k])))
        return found


class FileScene:
    """The bodies of a problem file and the room about them.

    Args:
        table: the table of the workspace.
        space: whether it is one of solids.
    """

    def __init__(self, table: Keys, *, space: bool) -> None:
        self.clearance = float(table.get("clearance", 0.0))
        self.space = space
        self.bounds = None if table.get("bounds") is None else np.reshape(table["bounds"], (2, -1))
        read = _solid if space else _flat
        self.bodies = [(row["name"], *read(row)) for row in table.get("obstacles", ())]

    def gaps(self, start: FloatArray, end: FloatArray, radius: float) -> Iterator[tuple[str, float]]:
        """Yield each body with its least gap from a link at T poses, told apart up to ``LOOK`` [m]."""
        if self.bounds is not None:
            ends = np.concatenate((start, end))
            yield "the room", float(min((ends - self.bounds[0]).min(), (self.bounds[1] - ends).min())) - radius
        for name, shape, place, rounding in self.bodies:
            if self.space:
                yield name, _least_gap(start, end, radius, shape, place)
            else:
                lines = shapely.linestrings(np.stack((start, end), axis=1))
                yield name, float(shapely.distance(lines, shape).min()) - radius - rounding


def body_gaps(arm: FileArm, scene: FileScene, points: FloatArray, frames: Any) -> Iterator[tuple[str, float]]:
    """Yield what bodies on links are near to at T poses, with the gap, told apart up to ``LOOK`` [m].

    Of the arm's own links and bodies, those that covers of bodies are clear of when the arm is straight.
    """
    for number, body in enumerate(arm.bodies):
        if scene.bounds is not None:
            yield "the room", _room_gap(body, arm, points, frames, scene.bounds)
        for name, shape, place, rounding in scene.bodies:
            fixed = [place if scene.space else shape] * len(points)
            yield name, _near(body, (points, frames), fixed, shape, rounding) - scene.clearance
        if arm.table.get("self_collision", True):
            yield from _own_gaps(arm, number, points, frames)


def _own_gaps(arm: FileArm, number: int, points: FloatArray, frames: Any) -> Iterator[tuple[str, float]]:
    body, rest = arm.bodies[number], arm.at_rest
    size = body.reach[1]
    for k in range(len(arm.lengths)):
        clear = body.beyond + 0.05 * (float(arm.radii[k]) + body.beyond + size)
        if k != body.link and _link_gap(body, arm, rest, k) > clear:
            yield f"link {k + 1}", _link_gap(body, arm, (points, frames), k)
    for second in arm.bodies[number + 1 :]:
        both = body.beyond + second.beyond
        if second.link != body.link and _pair_gap(body, second, rest) > both + 0.05 * (both + size + second.reach[1]):
            yield f"the body on link {second.link + 1}", _pair_gap(body, second, (points, frames))


def _room_gap(body: FileBody, arm: FileArm, points: FloatArray, frames: Any, bounds: FloatArray) -> float:
    """Least gap of a body from the sides of the room at T poses, at most ``LOOK`` [m]."""
    centre, radius = body.reach
    middles = arm.fixed(body.link, points, frames, centre)
    bound = np.minimum((middles - bounds[0]).min(axis=1), (bounds[1] - middles).min(axis=1)) - radius
    least = LOOK
    for k in np.flatnonzero(bound < LOOK).tolist():
        (at,) = body.at(points, frames, [k])
        if body.place is None:
            low, high = np.reshape(at.bounds, (2, 2))
        elif "mesh" in body.row:
            corners = np.array([at.transform(corner) for corner in body.shape.vertices()])
            low, high = corners.min(axis=0), corners.max(axis=0)
        else:
            reach = _half_box(body, at.getRotation())
            low, high = at.getTranslation() - reach, at.getTranslation() + reach
        least = min(least, float(min((low - bounds[0]).min(), (bounds[1] - high).min())) - body.rounding)
    return least


def _half_box(body: FileBody, turn: FloatArray) -> FloatArray:
    """Half the sides of the box with sides along the axes about a turned solid, shape (3,) [m]."""
    if "box" in body.row:
        return np.asarray(np.abs(turn * body.shape.halfSide).sum(axis=1))
    along = turn[:, 2]
    flat = np.sqrt(np.maximum(1.0 - along**2, 0.0)) if "cylinder" in body.row else np.ones(3)
    return np.asarray(np.abs(along) * getattr(body.shape, "halfLength", 0.0) + body.shape.radius * flat)


def _near(body: FileBody, poses: tuple[FloatArray, Any], others: Sequence[Any], shape: Any, rounding: float) -> float:
    """Least gap of a body from another thing, at most ``LOOK`` [m]; ``others`` are its places or shapes."""
    points, frames = poses
    request, result, least = coal.DistanceRequest(), coal.DistanceResult(), LOOK
    if body.place is None:
        gaps = shapely.distance(body.at(points, frames, range(len(points))), others)
        return min(LOOK, float(gaps.min()) - body.rounding - rounding)
    places = body.at(points, frames, range(len(points)))
    shape.computeLocalAABB()
    middles = np.array([place.transform(body.shape.aabb_center) for place in places])
    there = np.array([place.transform(shape.aabb_center) for place in others])
    bound = np.linalg.norm(middles - there, axis=1) - body.reach[1] - shape.aabb_radius
    for k in np.argsort(bound):
        if bound[k] >= least:
            break
        result.clear()
        least = min(least, coal.distance(body.shape, places[k], shape, others[k], request, result))
    return least


def _link_gap(body: FileBody, arm: FileArm, poses: tuple[FloatArray, Any], k: int) -> float:
    points, _ = poses
    start, end, radius = points[:, k], points[:, k + 1], float(arm.radii[k])
    if body.place is None:
        return _near(body, poses, shapely.linestrings(np.stack((start, end), axis=1)), None, radius)
    axes = [_along(*ends) for ends in zip(start, end, strict=True)]
    return _near(body, poses, axes, coal.Capsule(radius, float(arm.lengths[k])), 0.0)


def _pair_gap(body: FileBody, second: FileBody, poses: tuple[FloatArray, Any]) -> float:
    there = second.at(*poses, range(len(poses[0])))
    return _near(body, poses, there, second.shape, second.rounding)


def _flat(row: Keys) -> tuple[Any, Any, float]:
    if "capsule" in row:
        return shapely.LineString((row["capsule"]["from"], row["capsule"]["to"])), None, row["capsule"]["radius"]
    if "box" in row:
        return shapely.box(*row["box"]), None, 0.0
    if "circle" in row:
        return shapely.Point(row["circle"]["center"]), None, row["circle"]["radius"]
    return shapely.Polygon(row["polygon"]), None, 0.0


def _solid(row: Keys, folder: Path = Path()) -> tuple[Any, Any, float]:
    if "mesh" in row:
        mesh = trimesh.load_mesh(folder / row["mesh"])
        shape = coal.BVHModelOBBRSS()
        shape.beginModel(len(mesh.faces), len(mesh.vertices))
        shape.addVertices(np.array(row["scale"] * mesh.vertices))
        shape.addTriangles(np.array(mesh.faces, dtype=np.uint32))
        shape.endModel()
        turn = Rotation.from_euler("xyz", np.deg2rad(row["pose"]["rotation_deg"]))
        return shape, coal.Transform3s(turn.as_matrix(), np.array(row["pose"]["position"])), 0.0
    if "box" in row:
        low, high = np.array(row["box"], dtype=float)
        pose = row.get("pose", {})
        turn = Rotation.from_euler("xyz", np.deg2rad(pose.get("rotation_deg", (0.0, 0.0, 0.0))))
        place = np.array(pose.get("position", (0.0, 0.0, 0.0))) + turn.apply(0.5 * (low + high))
        return coal.Box(*(high - low)), coal.Transform3s(turn.as_matrix(), place), 0.0
    if "sphere" in row:
        place = np.array(row["sphere"]["center"], dtype=float)
        return coal.Sphere(row["sphere"]["radius"]), coal.Transform3s(np.eye(3), place), 0.0
    body = row.get("capsule") or row["cylinder"]
    first, last = np.array(body["from"], dtype=float), np.array(body["to"], dtype=float)
    kind = coal.Capsule if "capsule" in row else coal.Cylinder
    return kind(body["radius"], float(np.linalg.norm(last - first))), _along(first, last), 0.0


def _along(start: FloatArray, end: FloatArray) -> Any:
    """The frame in the middle of a segment whose z axis runs along it."""
    return coal.Transform3s(_turned(end - start), 0.5 * (start + end))


def _turned(line: FloatArray) -> FloatArray:
    """A rotation that takes z to a direction."""
    ahead = line / max(float(np.linalg.norm(line)), 1e-300)
    side = np.cross(ahead, np.eye(3)[int(np.argmin(np.abs(ahead)))])
    side /= np.linalg.norm(side)
    return np.column_stack((side, np.cross(ahead, side), ahead))


def _least_gap(start: FloatArray, end: FloatArray, radius: float, shape: Any, place: Any) -> float:
    """Least distance of a capsule at T poses from a solid, at most ``LOOK`` [m]."""
    shape.computeLocalAABB()
    centre = place.transform(shape.aabb_center)
    line = end - start
    share = np.clip(np.einsum("td,td->t", centre - start, line) / np.einsum("td,td->t", line, line), 0.0, 1.0)
    bound = np.linalg.norm(start + share[:, None] * line - centre, axis=1) - shape.aabb_radius - radius
    least = LOOK
    link = coal.Capsule(radius, float(np.linalg.norm(line[0])))
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    for k in np.argsort(bound):
        if bound[k] >= least:
            break
        result.clear()
        least = min(least, coal.distance(link, _along(start[k], end[k]), shape, place, request, result))
    return least


def least_own_gap(arm: FileArm, points: FloatArray) -> tuple[float, str]:
    """Least gap of links far apart along the arm at T poses, at most ``LOOK`` [m], and which."""
    least, which = LOOK, ""
    middles = 0.5 * (points[:, 1:] + points[:, :-1])
    for i, j in arm.pairs:
        thick = arm.radii[i] + arm.radii[j]
        bound = np.linalg.norm(middles[:, i] - middles[:, j], axis=1) - 0.5 * (arm.lengths[i] + arm.lengths[j]) - thick
        near = np.flatnonzero(bound < least)
        if len(near):
            ends = (points[near, i], points[near, i + 1], points[near, j], points[near, j + 1])
            gap = float(_segment_gaps(*ends).min()) - thick
            if gap < least:
                least, which = gap, f"links {i + 1} and {j + 1}"
    return least, which


def _segment_gaps(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> FloatArray:
    """Distances of segments pq and rs, each of shape (T, d): alternating projections between ends, and the lines."""
    line, other, away = q - p, s - r, p - r
    a, b, c = (np.einsum("td,td->t", *each) for each in ((line, line), (line, other), (other, other)))
    d, e = np.einsum("td,td->t", line, away), np.einsum("td,td->t", other, away)
    det = a * c - b * b
    inside = det > 1e-12 * a * c
    shares = [np.where(inside, np.clip((b * e - c * d) / np.where(inside, det, 1.0), 0.0, 1.0), 0.0)]
    shares += [np.zeros(len(a)), np.ones(len(a)), np.clip(-d / a, 0.0, 1.0), np.clip((b - d) / a, 0.0, 1.0)]
    gaps = []
    for share in shares:
        on_other = np.clip((b * share + e) / c, 0.0, 1.0)
        back = np.clip((b * on_other - d) / a, 0.0, 1.0)
        gaps.append(np.linalg.norm(away + back[:, None] * line - on_other[:, None] * other, axis=1))
    return np.asarray(np.min(gaps, axis=0))


def densely(arm: FileArm, bends: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows of a motion, linear between its samples, so near each other that no joint moves far from one to the next."""
    points = arm.placed(bends, axes)[0]
    travel = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
    along = np.concatenate(([0.0], np.cumsum(np.maximum(travel, 1e-9))))
    wanted = np.linspace(0.0, along[-1], int(np.ceil(along[-1] / TRAVEL)) + 1)
    at = np.interp(np.union1d(wanted, along[:: max(1, len(along) // 200)]), along, np.arange(len(along)))
    k = np.minimum(at.astype(int), len(bends) - 2)
    share = at - k

    def between(rows: FloatArray) -> FloatArray:
        part = share.reshape(-1, *[1] * (rows.ndim - 1))
        return np.asarray(rows[k] + part * (rows[k + 1] - rows[k]))

    return between(bends), between(axes)


def broken_promises(
    data: Keys, arrays: Mapping[str, FloatArray], folder: Path = Path(), kind: type[FileArm] = FileArm
) -> list[str]:
    """What a plan breaks, in words: contact, limits of bends and axes, start and goals.

    Args:
        data: the problem file, with lengths in metres.
        arrays: arrays of the plan's folder.
        folder: folder of the meshes of bodies on links.
        kind: what reads the arm; of another kind than ``FileArm``, its bends are those of drives.
    """
    space = data.get("space", 2) == 3
    arm, scene = kind(data["arm"], space, folder), FileScene(data["workspace"], space=space)
    bends = arrays["bend_angles"]
    if kind is not FileArm:
        bends = arrays["drive_values"].reshape(len(bends), arm.joints, *bends.shape[2:])
    axes = arrays["base_axes"] if "base_axes" in arrays else arrays.get("base_feed", np.zeros((len(bends), 0)))
    axes = axes.reshape(len(bends), -1)
    found: list[str] = []
    points, frames = arm.placed(bends, axes)
    if "tool_tip" in arrays and np.abs(arm.tips(points, frames) - arrays["tool_tip"]).max() > 1e-9:
        found.append("the tool's tip is not where the arrays say")
    shown = slice(-1, None) if kind is not FileArm else slice(None)
    if np.abs(points[:, shown] - arrays["joint_positions"][:, shown]).max() > 1e-9:
        found.append("joints are not where the arrays say")
    each = np.abs(bends).reshape(len(bends), arm.joints, -1).max(axis=0)
    over = (each - arm.limits[:, : each.shape[1]]).max(axis=1)
    if over.max() > 1e-6:
        found.append(f"joint {int(over.argmax()) + 1} is {over.max():.2g} rad beyond its limit")
    if "coupling" in data["arm"]:
        ratios = np.array(data["arm"]["coupling"])
        flat = bends.reshape(len(bends), -1)
        off = np.abs(flat - np.linalg.lstsq(ratios, flat.T, rcond=None)[0].T @ ratios.T).max()
        found += [f"joints are {off:.2g} rad out of their ratios"] if off > 1e-6 else []
    found += list(_beyond_ends(data, arrays, bends))
    found += list(_beyond_axes(data, arrays, arm, bends, axes))
    dense, turned = arm.placed(*densely(arm, bends, axes))
    allowed = TOUCH * max(float(arm.places[-1]), 0.1)
    for k, start, end in arm.exposed(dense):
        for name, gap in scene.gaps(start, end, float(arm.radii[k])):
            if gap < scene.clearance - allowed:
                found.append(f"link {k + 1} is {gap - scene.clearance:.2g} m too near to {name}")
    gap, which = least_own_gap(arm, dense)
    if gap < -allowed:
        found.append(f"{which} overlap by {-gap:.2g} m")
    own = {name for name, gap in body_gaps(arm, scene, dense, turned) if gap < -allowed}
    found += [f"a body on a link is too near to {name}" for name in sorted(own)]
    return found


def _beyond_ends(data: Keys, arrays: Mapping[str, FloatArray], bends: FloatArray) -> Iterator[str]:
    """Yield what start and goals miss."""
    start = data["start"]
    if np.abs(bends[0] - np.deg2rad(start.get("joints_deg", np.zeros(bends.shape[1:])))).max() > 1e-6:
        yield "the start is another"
    goals: Sequence[Keys] = data["goal"] if isinstance(data["goal"], list) else [data["goal"]]
    ends = arrays["joint_positions"][:, -2]
    tips = arrays.get("tool_tip", arrays["joint_positions"][:, -1])
    for goal, sample in zip(goals, (*arrays["stops"], len(tips) - 1), strict=True):
        if "position" in goal:
            away = float(np.linalg.norm(tips[sample] - goal["position"]))
            if away > goal.get("position_tolerance", 1e-3) + 1e-9:
                yield f"the tip misses a goal by {away:.2g} m"
            ahead, wanted = (np.array(each) for each in (tips[sample] - ends[sample], goal.get("direction", ())))
            if len(wanted):
                cosine = ahead @ wanted / np.linalg.norm(ahead) / np.linalg.norm(wanted)
                off = np.rad2deg(np.arccos(min(cosine, 1.0)))
                if off > goal.get("direction_tolerance_deg", 1.0) + 1e-6:
                    yield f"the tip points {off:.2g} degrees off a goal"
        elif np.abs(bends[sample] - np.deg2rad(goal["joints_deg"])).max() > np.deg2rad(1.001):
            yield "the pose misses a goal"


def _beyond_axes(
    data: Keys, arrays: Mapping[str, FloatArray], arm: FileArm, bends: FloatArray, axes: FloatArray
) -> Iterator[str]:
    """Yield axes beyond their range or too fast, and joints bent in the guide tube."""
    rows = data["arm"]["base"].get("axes", ()) if data.get("space") == 3 else ()
    for row, values in zip(rows, axes.T if rows else (), strict=True):
        low, high = row["range"] if row["kind"] == "prismatic" else np.deg2rad(row["range_deg"])
        if values.min() < low - 1e-9 or values.max() > high + 1e-9:
            yield "an axis is out of its range"
        if np.abs(np.diff(values) / np.diff(arrays["time"])).max() > row["velocity"] * 1.001:
            yield "an axis is too fast"
    feed = data["arm"].get("feed")
    if feed is not None:
        low, high = feed["range"]
        if axes.min() < low - 1e-9 or axes.max() > high + 1e-9:
            yield "the feed is out of its range"
        inside = axes + arm.joint_places < feed.get("hole", high) - 1e-8
        if np.abs(bends.reshape(*inside.shape, -1)[inside]).max(initial=0.0) > 1e-6:
            yield "a joint bends in the guide tube"
