"""What the view draws: arm, room and motion.

The scene counts in arm lengths, so that the camera and the handles suit arms of any size.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import shapely
import viser

from ccm_opt.cli.view import settings as colours
from ccm_opt.cli.view.frames import (
    Mesh,
    MotionFrames,
    SpaceFrames,
    ball,
    cylinder,
    extruded,
    in_space,
    turned,
    turned_to,
)
from ccm_opt.cli.view.settings import VIEW, ViewSettings
from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.scene.scene import SpaceObstacle
from ccm_opt.scene.surfaces import seen_triangles, within
from ccm_opt.viz.scene_data import route_layers

LAYERS = {"swept region": "/tube", "start": "/start", "route": "/route", "regions": "/regions", "names": "/names"}
"""What can be switched on and off, and where it stands in the scene."""


Frames = TypeVar("Frames", MotionFrames, SpaceFrames)


@dataclass
class _Scene(Generic[Frames]):
    """The scene of one motion; everything of it is drawn again when the motion changes.

    Attributes:
        server: shows it.
        frames: the motion.
        settings: of the pictures.
        shown: names of the layers that are switched on.
        colour_by: what the colours of the links mean: ``nothing``, ``gap`` or ``torque``.
        places: what can be switched on and off, and where it stands in the scene.
    """

    server: viser.ViserServer
    frames: Frames
    settings: ViewSettings = VIEW
    shown: set[str] = field(default_factory=lambda: {"start", "names"})
    colour_by: str = "nothing"
    _arm: Any = None
    _joints: Any = None
    places: ClassVar[Mapping[str, str]] = {}

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of what can be switched on and off."""
        return tuple(self.places)

    @property
    def unit(self) -> float:
        """Metres in a unit of the scene."""
        return float(self.frames.problem.arm.length)

    @property
    def radius(self) -> float:
        """That the arm is drawn with, in units of the scene."""
        return max(self.frames.problem.arm.radius / self.unit, self.settings.thin_arm)

    def world(self, points: FloatArray) -> FloatArray:
        """Places [m] in the scene, shape (..., 3)."""
        scaled = points / self.unit
        return in_space(scaled) if points.shape[-1] == 2 else scaled

    def draw(self) -> None:
        """Draw everything."""
        self.server.scene.set_up_direction("+z")
        self.draw_room(self.frames.problem)
        self.draw_motion()

    def draw_room(self, problem: Any) -> None:
        """Draw obstacles and goals of a problem, which may be ahead of the motion."""
        self._draw_obstacles(problem)
        goals = [*(stop.goal for stop in problem.stops), problem.goal]
        for number, goal in enumerate(goals, start=1):
            if isinstance(goal, TipGoal):
                self._draw_goal(goal, str(number) if len(goals) > 1 else "")

    def _draw_obstacles(self, problem: Any) -> None:
        raise NotImplementedError

    def _draw_goal(self, goal: TipGoal, number: str) -> None:
        name, place = f"/goal{number}", self.world(goal.position)
        self.server.scene.add_icosphere(name, radius=1.4 * self.radius, color=colours.GOAL, opacity=0.6, position=place)
        if number:
            self.server.scene.add_label(f"{name}/number", number)
        if goal.heading is not None:
            wxyz = turned(np.array(goal.heading))
        elif goal.direction is not None:
            wxyz = turned_to(goal.direction)
        if goal.direction is not None:
            mesh = cylinder(6.0 * self.radius, 0.35 * self.radius, self.settings.sides)
            self._mesh(f"{name}/pointing", mesh, colours.GOAL, wxyz=wxyz)

    def draw_motion(self) -> None:
        """Draw the arm and all that belongs to the motion."""
        arm = self.frames.problem.arm
        scene = self.server.scene
        link = cylinder(arm.link_length / self.unit, self.radius, self.settings.sides)
        start = self.world(self.frames.points[0])
        self._arm = scene.add_batched_meshes_simple(
            "/arm/links", *link, _turns(start), start[:-1], batched_colors=colours.plain(arm.links)
        )
        upright = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (arm.links + 1, 1))
        self._joints = scene.add_batched_meshes_simple(
            "/arm/joints", *ball(self.radius), upright, start, batched_colors=colours.plain(arm.links + 1)
        )
        chosen = np.linspace(0, len(self.frames.points) - 1, self.settings.frames).astype(int)
        self._line("/tip", self.world(self.frames.points[chosen, -1]), colours.ROUTE, 0.004)
        self._draw_layers(start)
        self.pose(0.0)

    def _draw_layers(self, start: FloatArray) -> None:
        raise NotImplementedError

    def switch(self, layer: str, *, on: bool) -> None:
        """Switch a layer on or off."""
        self.shown.add(layer) if on else self.shown.discard(layer)
        if layer == "names":
            self._forget_names()
            self.draw_room(self.frames.problem)
        elif on:
            self.draw_motion()
        else:
            self.server.scene.remove_by_name(self.places[layer])

    def _forget_names(self) -> None:
        """Let obstacles be drawn again with their names, or without."""

    def pose(self, time: float) -> None:
        """Show the arm at a time [s]."""
        points = self.world(self.frames.pose(time))
        self._arm.batched_positions = points[:-1]
        self._arm.batched_wxyzs = _turns(points)
        coloured = self._colours(time)
        self._arm.batched_colors = coloured
        # A joint is as the link before it, which it ends.
        self._joints.batched_colors = np.vstack((coloured[:1], coloured))
        self._joints.batched_positions = points

    def _colours(self, time: float) -> colours.Colours:
        problem = self.frames.problem
        if self.colour_by == "gap":
            return colours.by_gap(self.frames.gaps(time), max(2.0 * problem.default_gap, 1e-12))
        if self.colour_by == "torque":
            return colours.by_use(self.frames.torque_shares(time))
        return colours.plain(problem.arm.links)

    def _mesh(self, name: str, mesh: Mesh, colour: tuple[int, int, int], **options: Any) -> None:
        self.server.scene.add_mesh_simple(name, *mesh, color=colour, side="double", **options)

    def _line(self, name: str, places: FloatArray, colour: tuple[int, int, int], thickness: float) -> None:
        """Draw a line through places of the scene, shape (n, 3)."""
        pieces = np.stack((places[:-1], places[1:]), axis=1)
        self.server.scene.add_line_segments(name, pieces, colour, thickness=thickness)


@dataclass
class Scene(_Scene[MotionFrames]):
    """The scene of one motion in the plane, whose obstacles reach before it and behind it."""

    _standing: tuple[object, bool] | None = None
    places = LAYERS

    @property
    def depth(self) -> float:
        """How far obstacles reach before and behind the plane, in units of the scene."""
        return max(self.settings.depth * self.radius, self.settings.least_depth)

    def look(self, client: viser.ClientHandle) -> None:
        """Put a client's camera before the room."""
        low_x, low_y, high_x, high_y = np.array(self.frames.problem.workspace.boundary.bounds) / self.unit
        middle = np.array([0.5 * (low_x + high_x), 0.0, 0.5 * (low_y + high_y)])
        away = max(high_x - low_x, high_y - low_y)
        client.camera.position = middle + np.array([0.12 * away, -away, 0.25 * away])
        client.camera.look_at = middle

    def _draw_obstacles(self, problem: Problem) -> None:
        # Most drags move the goal alone, and leave the room the same object.
        named = "names" in self.shown
        new = self._standing is None or self._standing[0] is not problem.workspace or self._standing[1] != named
        self._standing = (problem.workspace, named)
        boundary = shapely.get_coordinates(problem.workspace.boundary.exterior) / self.unit
        for name, depth in (("near", -self.depth), ("far", self.depth)):
            ring = in_space(boundary, depth)
            segments = np.stack((ring[:-1], ring[1:]), axis=1)
            self.server.scene.add_line_segments(f"/room/{name}", segments, colours.WALLS, thickness=0.004)
        for obstacle in problem.workspace.obstacles if new else ():
            self._draw_obstacle(obstacle.name, obstacle.outline(quad_segs=self.settings.curved))

    def _draw_obstacle(self, name: str, outline: shapely.Geometry) -> None:
        """Draw one obstacle, in place of an earlier one of that name."""
        shape = shapely.transform(outline, lambda places: places / self.unit)
        vertices, faces = extruded(shape, -self.depth, self.depth)
        path = path_of("/room", name)
        self.server.scene.add_mesh_simple(path, vertices, faces, color=colours.WALLS, opacity=0.75, side="double")
        middle = shapely.get_coordinates(shapely.point_on_surface(shape))[0]
        place = in_space(middle, -self.depth)
        visible = "names" in self.shown
        self.server.scene.add_label(path_of("/names", name), name, position=place, visible=visible)

    def _draw_layers(self, start: FloatArray) -> None:
        """Draw the start, and what is costly if anybody wants to see it."""
        scene = self.server.scene
        scene.add_spline_catmull_rom(
            LAYERS["start"], start, color=colours.START, thickness=0.6 * self.radius, visible="start" in self.shown
        )
        if "swept region" in self.shown:
            swept = shapely.transform(self.frames.swept(), lambda places: places / self.unit)
            mesh = extruded(swept, -0.2 * self.radius, 0.2 * self.radius)
            self._mesh(LAYERS["swept region"], mesh, colours.TUBE, opacity=0.35)
        if not self.shown & {"route", "regions"}:
            return
        layers = route_layers(self.frames.problem, self.frames.points[-1])
        route = np.array(layers.get("route", []), dtype=np.float64)
        if "route" in self.shown and len(route) > 1:
            self._line(LAYERS["route"], self.world(route), colours.GOAL, 0.006)
        regions = layers.get("regions", [])
        if "regions" in self.shown and isinstance(regions, list) and regions:
            rings = [self.world(np.array([*ring, ring[0]], dtype=np.float64)) for ring in regions]
            sides = np.vstack([np.stack((ring[:-1], ring[1:]), axis=1) for ring in rings])
            scene.add_line_segments(LAYERS["regions"], sides, colours.REGION, thickness=0.003)


def path_of(folder: str, name: str) -> str:
    """Where something of a name stands in the scene; a slash in it would make a branch."""
    return f"{folder}/{name.replace('/', '|')}"


SPACE_LAYERS = {"start": "/start", "poses on the way": "/poses", "names": "/names"}
"""What can be switched on and off, and where it stands in the scene."""


@dataclass
class SpaceScene(_Scene[SpaceFrames]):
    """The scene of one motion in space; its obstacles can be seen through."""

    opacity: float = VIEW.glass
    _standing: dict[str, SpaceObstacle] = field(default_factory=dict)
    places = SPACE_LAYERS

    def look(self, client: viser.ClientHandle) -> None:
        """Put a client's camera before the arm and what is about it."""
        points = self.frames.points.reshape(-1, 3) / self.unit
        low = points.min(axis=0)
        high = points.max(axis=0)
        middle = 0.5 * (low + high)
        away = max(float(np.max(high - low)), 0.5)
        client.camera.position = middle + 1.2 * away * np.array([0.35, -0.85, 0.4])
        client.camera.look_at = middle

    def _draw_obstacles(self, problem: SpaceProblem) -> None:
        obstacles = problem.workspace.obstacles
        most = self.settings.most_triangles // max(len(obstacles), 1)
        extent = float(np.max(np.ptp(problem.workspace.extent, axis=0), initial=problem.arm.length))
        for obstacle in obstacles:
            # Most drags move one body, and leave the others the same objects.
            if self._standing.get(obstacle.name) is obstacle:
                continue
            self._standing[obstacle.name] = obstacle
            surface = seen_triangles(obstacle.body, 4 * self.settings.curved)
            vertices, faces = within(*surface, most, self.settings.cell * extent)
            self.server.scene.add_mesh_simple(
                path_of("/room", obstacle.name), vertices / self.unit, faces, color=colours.WALLS,
                opacity=self.opacity, side="double", flat_shading=True,
            )  # fmt: skip
            middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0)) / self.unit
            self.server.scene.add_label(
                path_of("/names", obstacle.name), obstacle.name, position=middle, visible="names" in self.shown
            )
        if problem.workspace.bounds is not None:
            self._draw_bounds(problem.workspace.bounds / self.unit)

    def _draw_bounds(self, bounds: FloatArray) -> None:
        """Draw the edges of the room."""
        counted = np.arange(8)[:, None] >> np.arange(3) & 1
        corners = np.where(counted == 1, bounds[1], bounds[0])
        edges = np.array([corners[[a, a | bit]] for a in range(8) for bit in (1, 2, 4) if not a & bit])
        self.server.scene.add_line_segments("/room/edges", edges, colours.WALLS, thickness=0.003)

    def _draw_layers(self, start: FloatArray) -> None:
        if "start" in self.shown:
            self._line(SPACE_LAYERS["start"], start, colours.START, 0.006)
        if "poses on the way" in self.shown:
            few = np.linspace(0, len(self.frames.points) - 1, self.settings.poses).astype(int)
            points = self.world(self.frames.points[few])
            pieces = np.stack((points[:, :-1], points[:, 1:]), axis=2).reshape(-1, 2, 3)
            self.server.scene.add_line_segments(SPACE_LAYERS["poses on the way"], pieces, colours.TUBE, thickness=0.003)

    def _forget_names(self) -> None:
        self._standing = {}


def _turns(points: FloatArray) -> FloatArray:
    """Quaternions that turn world x along the links between places, shape (n + 1, 3) to (n, 4)."""
    along = np.diff(points, axis=0)
    return turned_to(along / np.linalg.norm(along, axis=1, keepdims=True))
