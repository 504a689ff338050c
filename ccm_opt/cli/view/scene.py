"""Scene of the viewer: arm, workspace and motion.

The unit of length of the scene is the arm's length, so that camera and handles suit arms of any size. Planar problems
lie in the x-z plane of the scene.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
import viser

from ccm_opt.cli.view import settings as colours
from ccm_opt.cli.view.frames import Mesh, MotionFrames, cut_away, extruded, rotation_to_axis
from ccm_opt.cli.view.settings import VIEW
from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Goal, Problem
from ccm_opt.scene.bodies import capsule_surface
from ccm_opt.scene.surfaces import within
from ccm_opt.scene.tool_links import own_joints
from ccm_opt.scene.workspace import Obstacle
from ccm_opt.viz.scene_data import route_layers
from ccm_opt.viz.scene_views import viewing_side
from ccm_opt.viz.sight import goal_sights
from ccm_opt.viz.work_box import corners, work_box

LAYERS = {
    "start": "/start",
    "poses on the way": "/poses",
    "swept region": "/tube",
    "route": "/route",
    "regions": "/regions",
    "names": "/names",
}
"""Paths in the scene of the layers that can be switched on and off, by name."""
_UP = np.array([0.0, 0.0, 1.0])
_IN_FRONT = np.array([0.1, -0.97, 0.22]) / np.linalg.norm([0.1, -0.97, 0.22])
"""Direction from planar scenes to the camera."""
_IN_SPACE = ("start", "poses on the way", "names")
"""Names of the layers that exist for arms in space."""


@dataclass
class Scene:
    """Scene of a motion in the browser, which can be redrawn for another motion.

    Attributes:
        server: web server that shows the scene.
        frames: the motion.
        shown: names of the layers that are switched on.
        colour_by: quantity that determines the colours of the links: ``nothing``, ``gap`` or ``torque``.
        opacity: opacity of obstacles in space, from 0 to 1.
        cut: axis across which obstacles in space are cut, and the coordinate beyond which they are not drawn [m]; None
            if they are drawn whole.
    """

    server: viser.ViserServer
    frames: MotionFrames
    shown: set[str] = field(default_factory=lambda: {"start", "names"})
    colour_by: str = "nothing"
    opacity: float = VIEW.glass
    cut: tuple[int, float] | None = None
    _links: Any = None
    _joints: Any = None
    _labels: dict[str, Any] = field(default_factory=dict)
    _obstacles: dict[str, Any] = field(default_factory=dict)
    _standing: dict[str, Obstacle] = field(default_factory=dict)

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the layers available for this problem."""
        return tuple(LAYERS) if self.frames.problem.dimension == 2 else _IN_SPACE

    @property
    def unit(self) -> float:
        """Length of one unit of the scene, the length of the arm [m]."""
        return float(self.frames.problem.arm.length)

    @property
    def radius(self) -> float:
        """Radius with which the arm is displayed, in units of the scene."""
        return max(self.frames.problem.arm.radius / self.unit, VIEW.thin_arm)

    @property
    def radii(self) -> FloatArray:
        """Radius with which each part of the arm is displayed, 0 for bare parts, shape (m,), in units of the scene."""
        chain = self.frames.chain
        return np.where(chain.bare, 0.0, np.maximum(np.nan_to_num(chain.radii) / self.unit, VIEW.thin_arm))

    @property
    def depth(self) -> float:
        """Extrusion depth of planar obstacles to each side of the plane, in units of the scene."""
        return max(VIEW.depth * self.radius, VIEW.least_depth)

    def world(self, points: FloatArray, behind: float = 0.0) -> FloatArray:
        """Return points of the problem, shape (..., d) with d = 2 or 3 [m], in scene coordinates, shape (..., 3).

        Args:
            points: the points.
            behind: shift away from the viewer, perpendicular to the plane of planar problems [scene units].
        """
        placed = self.frames.problem.arm.embedded(points / self.unit)
        return placed + np.array([0.0, behind, 0.0]) if behind else placed

    def look(self, client: viser.ClientHandle) -> None:
        """Place the camera of a connected browser so that the workspace, or in space the work, fills its window."""
        problem, camera = self.frames.problem, client.camera
        if problem.dimension == 3:
            work = np.concatenate((self.frames.points[:, -1], self.frames.points[-1]))
            seen, ahead = corners(work_box(problem, self.frames.points, work)), viewing_side(work).ahead
        else:
            seen, ahead = corners(np.reshape(problem.workspace.boundary.bounds, (2, 2))), _IN_FRONT
        seen = self.world(seen)
        middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
        across = np.cross(_UP, ahead)
        across /= np.linalg.norm(across)
        x, y, near = np.stack((across, np.cross(ahead, across), ahead)) @ (seen - middle).T
        # In a window that is higher than wide, the panel covers the lower part.
        low, high = np.tan(0.5 * camera.fov) * np.array(VIEW.above_panel if camera.aspect < 1.0 else VIEW.in_window)
        wide = np.tan(0.5 * camera.fov) * VIEW.in_window[1] * camera.aspect
        # From there on every corner is seen within the edges of that part of the window.
        within = 2.0 * np.maximum(y + high * near, -y - low * near) / (high - low)
        distance = float(np.max(np.maximum(near + np.abs(x) / wide, within)))
        middle -= 0.5 * (low + high) * distance * np.cross(ahead, across)
        camera.position = middle + distance * ahead
        camera.look_at = middle

    def draw(self) -> None:
        """Draw the whole scene: workspace, goals and motion."""
        scene = self.server.scene
        scene.set_up_direction("+z")
        # Shadows and reflected surroundings would take 85 % of a frame's time where no graphics card renders it; walls
        # of glass throw none, and matt surfaces reflect little.
        scene.configure_default_lights(cast_shadow=False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/daylight", intensity=VIEW.daylight)
        self.draw_bounds(self.frames.problem)
        self.draw_motion()

    def draw_bounds(self, problem: Problem) -> None:
        """Draw workspace, obstacles and goals of a problem, which may be newer than the motion shown."""
        self._draw_walls(problem)
        workspace = problem.workspace
        obstacles: tuple[Obstacle, ...] = workspace.obstacles
        most = VIEW.most_triangles // max(len(obstacles), 1)
        extent = np.ptp(workspace.extent, axis=0) if workspace.dimension == 3 else ()
        cell = VIEW.cell * float(np.max(extent, initial=self.unit))
        for obstacle in obstacles:
            # A drag moves one obstacle or the goal; all other obstacles stay identical objects and need no redrawing.
            if self._standing.get(obstacle.name) is not obstacle:
                self._standing[obstacle.name] = obstacle
                self._draw_obstacle(obstacle, most, cell)
        for number, stop in enumerate(problem.goals, start=1):
            self._draw_goal(stop.goal, number, stop.goal.name or (f"goal {number}" if problem.stops else "goal"))

    def _draw_walls(self, problem: Problem) -> None:
        """Draw the edges of the workspace bounds."""
        workspace = problem.workspace
        if workspace.dimension == 2:
            ring = shapely.get_coordinates(workspace.boundary.exterior)
            for name, depth in (("near", -self.depth), ("far", self.depth)):
                self._line(f"/room/{name}", self.world(ring, depth), colours.WALLS, 2.5)
        elif workspace.bounds is not None:
            counted = np.arange(8)[:, None] >> np.arange(3) & 1
            corners = self.world(np.where(counted == 1, workspace.bounds[1], workspace.bounds[0]))
            edges = np.array([corners[[a, a | bit]] for a in range(8) for bit in (1, 2, 4) if not a & bit])
            self._segments("/room/edges", edges, colours.WALLS, 2.5)

    def _draw_obstacle(self, obstacle: Obstacle, most_triangles: int, cell: float) -> None:
        """Draw one obstacle, replacing an earlier one of the same name; obstacles in space are transparent.

        Args:
            obstacle: the obstacle, planar or in space.
            most_triangles: maximum number of triangles of an obstacle in space.
            cell: initial width of the grid cells in which vertices are merged to reduce triangles [m].
        """
        if self.frames.problem.dimension == 2:
            outline = obstacle.outline(quad_segs=VIEW.curved)
            vertices, faces = extruded(
                shapely.transform(outline, lambda places: places / self.unit), -self.depth, self.depth
            )
            middle = self.world(shapely.get_coordinates(shapely.point_on_surface(outline))[0], -self.depth)
            look: dict[str, Any] = {"opacity": 0.75}
        else:
            surface = obstacle.body.surface(4 * VIEW.curved)
            vertices, faces = within(*surface, most_triangles, cell)
            middle = self.world(0.5 * (vertices.min(axis=0) + vertices.max(axis=0)))
            if self.cut is not None:
                vertices, faces = cut_away((vertices, faces), *self.cut)
            vertices = self.world(vertices)
            look = {"opacity": self.opacity, "flat_shading": True}
        path = scene_path("/room", obstacle.name)
        if len(faces):
            self._obstacles[path] = self._mesh(path, (vertices, faces), colours.WALLS, **look)
        elif self._obstacles.pop(path, None):
            self.server.scene.remove_by_name(path)
        self._label(scene_path("/names", obstacle.name), obstacle.name, middle, visible="names" in self.shown)

    def _label(self, path: str, text: str, place: FloatArray, *, visible: bool = True) -> None:
        """Draw a name at a place in scene coordinates, shape (3,)."""
        self._labels[path] = self.server.scene.add_label(
            path, text, position=place, visible=visible, anchor="center-center", font_screen_scale=VIEW.names
        )

    def shade(self, opacity: float) -> None:
        """Set the opacity of obstacles in space, from 0 to 1."""
        self.opacity = opacity
        for mesh in self._obstacles.values():
            mesh.opacity = opacity

    def cut_across(self, axis: int | None, share: float) -> None:
        """Draw obstacles in space only up to a plane across an axis, or whole.

        Args:
            axis: index of the axis; None to draw them whole.
            share: place of the plane, as a fraction of the extent of all obstacles along the axis.
        """
        low, high = self.frames.problem.workspace.extent
        self.cut = None if axis is None else (axis, float(low[axis] + share * (high[axis] - low[axis])))
        self._standing = {}
        self.draw_bounds(self.frames.problem)

    def arrange_names(self, camera: viser.CameraHandle) -> None:
        """Hide the names that would cover others as seen by a camera: goals come first, then what is nearest."""
        if "names" not in self.shown or not self._labels:
            return
        labels = list(self._labels.values())
        places = np.array([label.position for label in labels]) - camera.position
        x, y, depth = rotation_matrix(np.asarray(camera.wxyz)).T @ places.T
        pixels = 0.5 * camera.image_height / np.tan(0.5 * camera.fov) / np.maximum(depth, 1e-9)
        goals = [path.startswith("/goals") for path in self._labels]
        widths = np.array([VIEW.letter * len(label.text) + VIEW.letter for label in labels])
        taken: list[tuple[float, float, float]] = []
        for k in sorted(range(len(labels)), key=lambda k: (not goals[k], depth[k])):
            across, down, wide = float(x[k] * pixels[k]), float(y[k] * pixels[k]), float(widths[k])
            covers = any(
                abs(across - other) < 0.5 * (wide + width) and abs(down - height) < VIEW.line
                for other, height, width in taken
            )
            shown = bool(depth[k] > 0.0 and not covers)
            if shown:
                taken.append((across, down, wide))
            if labels[k].visible != shown:
                labels[k].visible = shown

    def _draw_goal(self, goal: Goal, number: int, name: str) -> None:
        path, place = f"/goal/{number}", self.world(goal.tip(self.frames.problem.arm))
        self.server.scene.add_icosphere(path, radius=1.4 * self.radius, color=colours.GOAL, position=place)
        # The name stands below the goal, whose handle it would cover otherwise.
        self._label(f"/goals/{number}", name, place - np.array([0.0, 0.0, 2.8 * self.radius]))
        if goal.direction is not None:
            mesh = capsule_surface(6.0 * self.radius, 0.35 * self.radius, VIEW.sides)
            wxyz = rotation_to_axis(self.frames.problem.arm.embedded(goal.direction))
            self._mesh(f"{path}/pointing", mesh, colours.GOAL, wxyz=wxyz)

    def draw_motion(self) -> None:
        """Draw the arm, the tip path, and all layers that depend on the motion."""
        scene = self.server.scene
        start = self.world(self.frames.points[0])
        ball = np.tile((1.0, 0.0, 0.0, 0.0), (len(start), 1))
        self._links = scene.add_batched_meshes_simple("/arm/links", *_tube(VIEW.sides), ball[1:], start[:-1])
        self._joints = scene.add_batched_meshes_simple(
            "/arm/joints",
            *capsule_surface(0.0, 1.0, VIEW.sides),
            ball,
            start,
            batched_scales=np.maximum(np.append(0.0, self.radii), np.append(self.radii, 0.0)),
        )
        chosen = np.linspace(0, len(self.frames.points) - 1, VIEW.frames).astype(int)
        self._line("/tip", self.world(self.frames.points[chosen, -1]), colours.ROUTE, 2.5)
        for number, line, edge in goal_sights(self.frames.problem, self.frames.trajectory):
            self._line(f"/sight {number}", self.world(line), colours.GOAL, 2.5)
            self._line(f"/field of view {number}", self.world(np.vstack((line[:1], edge, line[:1]))), colours.GOAL, 2.5)
        self._draw_layers(start[own_joints(self.frames.problem.arm)])
        self.pose(0.0)

    def _draw_layers(self, start: FloatArray) -> None:
        """Draw those layers that are switched on: the start pose and the layers that take long to compute."""
        scene = self.server.scene
        if "start" in self.shown:
            scene.add_spline_catmull_rom(LAYERS["start"], start, color=colours.START, thickness=0.6 * self.radius)
        if "poses on the way" in self.shown:
            few = np.linspace(0, len(self.frames.points) - 1, VIEW.poses).astype(int)
            points = self.world(self.frames.points[few][:, own_joints(self.frames.problem.arm)])
            pieces = np.stack((points[:, :-1], points[:, 1:]), axis=2).reshape(-1, 2, 3)
            self._segments(LAYERS["poses on the way"], pieces, colours.TUBE, 2.5)
        if "swept region" in self.shown:
            swept = shapely.transform(self.frames.swept(), lambda places: places / self.unit)
            mesh = extruded(swept, -0.2 * self.radius, 0.2 * self.radius)
            self._mesh(LAYERS["swept region"], mesh, colours.TUBE, opacity=0.35)
        problem = self.frames.problem
        if self.shown & {"route", "regions"} and problem.dimension == 2:
            self._draw_route(route_layers(problem, self.frames.points[-1]))

    def _draw_route(self, layers: dict[str, object]) -> None:
        """Draw the shortest path homotopic to the final pose, and the convex regions along it, if switched on."""
        route = np.array(layers.get("route", []), dtype=np.float64)
        if "route" in self.shown and len(route) > 1:
            self._line(LAYERS["route"], self.world(route), colours.GOAL, 3.0)
        regions = layers.get("regions", [])
        if "regions" in self.shown and isinstance(regions, list) and regions:
            rings = [self.world(np.array([*ring, ring[0]], dtype=np.float64)) for ring in regions]
            sides = np.vstack([np.stack((ring[:-1], ring[1:]), axis=1) for ring in rings])
            self._segments(LAYERS["regions"], sides, colours.REGION, 2.5)

    def switch(self, layer: str, *, on: bool) -> None:
        """Switch a layer of the given name on or off."""
        self.shown.add(layer) if on else self.shown.discard(layer)
        if layer == "names":
            self._standing = {}
            self.draw_bounds(self.frames.problem)
        elif on:
            self.draw_motion()
        else:
            self.server.scene.remove_by_name(LAYERS[layer])

    def pose(self, time: float) -> None:
        """Show the arm in its pose at a time [s]."""
        self.place(self.frames.pose(time))
        shown = self._colours(time)
        self._links.batched_colors = shown
        # A joint is the end of the thicker one of the parts that meet there.
        before, after = np.append(0.0, self.radii), np.append(self.radii, 0.0)
        part = np.arange(len(before)) - (before >= after)
        self._joints.batched_colors = shown[np.maximum(part, 0)]

    def place(self, ends: FloatArray) -> None:
        """Show the arm with the ends of its parts at given places, shape (m + 1, d) [m]."""
        points = self.world(ends)
        along = np.diff(points, axis=0)
        lengths = np.linalg.norm(along, axis=1)
        self._links.batched_positions = points[:-1]
        self._links.batched_wxyzs = rotation_to_axis(along / lengths[:, None])
        self._links.batched_scales = np.stack((lengths, self.radii, self.radii), axis=1)
        self._joints.batched_positions = points

    def _colours(self, time: float) -> colours.Colours:
        problem = self.frames.problem
        if self.colour_by == "gap":
            return colours.by_gap(self.frames.gaps(time), max(2.0 * problem.default_gap, 1e-12))
        if self.colour_by == "torque":
            return colours.by_use(self.frames.torque_shares(time)[self.frames.chain.carriers])
        return colours.plain(len(self.radii))

    def _mesh(self, name: str, mesh: Mesh, colour: tuple[int, int, int], **options: Any) -> Any:
        return self.server.scene.add_mesh_simple(name, *mesh, color=colour, side="double", **options)

    def _line(self, name: str, places: FloatArray, colour: tuple[int, int, int], width: float) -> None:
        """Draw a line through points in scene coordinates, shape (n, 3), with a width [pixels]."""
        self._segments(name, np.stack((places[:-1], places[1:]), axis=1), colour, width)

    def _segments(self, name: str, pieces: FloatArray, colour: tuple[int, int, int], width: float) -> None:
        """Draw line segments in scene coordinates, shape (n, 2, 3), with a width [pixels]."""
        self.server.scene.add_line_segments(name, pieces, colour, thickness=width, thickness_units="screen")


def scene_path(folder: str, name: str) -> str:
    """Return the path of a named object in the scene; slashes in the name, which would nest objects, are replaced."""
    return f"{folder}/{name.replace('/', '|')}"


def rotation_matrix(wxyz: FloatArray) -> FloatArray:
    """Return the rotation matrix, shape (3, 3), of a unit quaternion (w, x, y, z)."""
    w, x, y, z = wxyz
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _tube(sides: int) -> Mesh:
    """Return an open cylinder along x of length and radius 1 with a number of sides."""
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    ring = np.column_stack((np.zeros(sides), np.cos(angles), np.sin(angles)))
    here = np.arange(sides)
    following = np.roll(here, -1)
    faces = (
        np.column_stack((here, following, sides + following)),
        np.column_stack((here, sides + following, sides + here)),
    )
    return np.concatenate((ring, ring + np.eye(3)[0])), np.concatenate(faces)
