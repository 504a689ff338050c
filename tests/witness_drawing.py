"""Construction of a random scene around a feasible motion, called its witness."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.cli.compare.space_clutter import arm_of_links
from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, RigidPlacement

from .space_shapes import ORIGIN, Bodies, Route, UselessDraw, bands, outline_about, sheet, thick_plate, unit
from .witness_motions import MOST_BEND, Swept, followed, smooth_bends

IN_TUBE = 0.05
"""Depth of the tip in the guide tube for a start inside [m]."""
Z = np.eye(3)[2]


@dataclass(eq=False)
class Drawing:
    """Random scene under construction, with end of the guide tube, or fixed base, at the origin and directed along x.

    Attributes:
        rng: random generator.
        links: number of links.
        start: "inside" for a start in the guide tube, "out" for one fed out of it.
        length: length of the arm [m].
        radius: radius of the arm [m].
        legs: configurations of consecutive motions, each of shape (T, c) [rad, m]; each begins where the last one ends.
        stops: numbers, from 1, of the legs that end at a goal.
        bodies: bodies by name.
        fed: whether the arm has a feed axis.
    """

    rng: np.random.Generator
    links: int
    start: str
    length: float = 1.2
    radius: float = 0.01
    legs: list[FloatArray] = field(default_factory=list)
    stops: list[int] = field(default_factory=list)
    bodies: Bodies = field(default_factory=dict)
    fed: bool = True

    @property
    def arm(self) -> Arm:
        """The arm, with joint limits of 90°."""
        arm = replace(arm_of_links(self.links, self.length, self.radius), joint_limit=0.5 * np.pi)
        if not self.fed:
            return arm
        base = np.array([-self.length - IN_TUBE, 0.0, 0.0])
        return replace(arm, base=base, feed=Feed(0.0, self.length + IN_TUBE, self.length + IN_TUBE))

    @property
    def link(self) -> float:
        """Length of a link [m]."""
        return self.length / self.links

    def lead(self) -> float:
        """Return a random length, more than a link, of the straight start of a path out of the guide tube [m]."""
        return self.link + float(self.rng.uniform(0.01, 0.04))

    def bend(self) -> float:
        """Return a random radius of curvature that the arm can follow [m]."""
        return max(0.08, 1.3 * self.link) * float(self.rng.uniform(1.0, 1.3))

    def room(self) -> float:
        """Return a random clearance around the witness [m]."""
        return float(self.rng.uniform(0.0042, 0.011))

    def go(self, route: Route, end: float | None = None, begin: float | None = None) -> Swept:
        """Add a motion along a path, with a goal at the end if it leads forwards, and return its swept volume.

        Args:
            route: the path.
            end: arc length of the tip at the end [m]; that of the path's end by default.
            begin: arc length of the tip at the beginning [m]; that of the start by default.

        Raises:
            UselessDraw: the arm is too short for the path, or cannot follow it.
        """
        shown = self.link if self.start == "out" else -IN_TUBE
        begin = shown if begin is None else begin
        end = route.length if end is None else end
        if end > self.length:
            raise UselessDraw
        count = max(10, int(abs(end - begin) / min(0.012, 0.3 * self.link)))
        self.legs.append(followed(self.arm, route, np.linspace(begin, end, count)))
        if end > begin:
            self.stops.append(len(self.legs))
        return Swept(self.arm, self.legs[-1])

    def strew(self, draw: Callable[[], Body], name: str, count: int) -> None:
        """Add at most ``count`` random bodies beside all legs, with numbered names."""
        swept = Swept(self.arm, np.concatenate(self.legs))
        for k, body in enumerate(swept.strew(self.rng, draw, count, self.room)):
            self.bodies[f"{name} {k}"] = body

    def bar(self, low: float, high: float, radius: float) -> CapsuleBody:
        """Return a bar at the origin with a random direction and a random length between two bounds [m]."""
        half = 0.5 * float(self.rng.uniform(low, high)) * unit(self.rng.normal(size=3))
        return CapsuleBody(-half, half, radius)

    def block(self, low: float, high: float) -> BoxBody:
        """Return a box at the origin with a random orientation and random sides between two bounds [m]."""
        half = 0.5 * self.rng.uniform(low, high, 3)
        return BoxBody(-half, half, RigidPlacement.of_quaternion(ORIGIN, self.rng.normal(size=4)))

    def jagged(self, size: float) -> Body:
        """Return a solid ring at the origin with a triangular section, as a mesh of about a given size [m]."""
        rings = [r * outline_about(z * Z, Z, 1.0, square=False) + (1.0 - r) * z * Z for r, z in self._profile(size)]
        return sheet(*bands(rings, closed=True), solid=True)

    def _profile(self, size: float) -> list[tuple[float, float]]:
        """Return radius and height of the three corners of a ring's section [m]."""
        wide = size * float(self.rng.uniform(0.3, 0.5))
        return [(0.5 * wide, 0.0), (wide, 0.3 * size), (wide, -0.3 * size)]

    def plate(self, name: str, place: FloatArray, normal: FloatArray, swept: Swept, half: float) -> None:
        """Add a plate with a hole through which the witness passes.

        Args:
            name: name of the plate.
            place: centre of the plate, shape (3,) [m].
            normal: unit normal of the plate, shape (3,).
            swept: swept volume of the arm.
            half: half the side of the plate [m].
        """
        middle, hole = swept.opening(place, normal, self.room())
        thick = float(self.rng.uniform(0.001, 0.003))
        outline = outline_about(place, normal, half)
        self.bodies[name] = thick_plate(middle, normal, hole + 0.5 * thick, outline, thick)

    def tilted(self, way: FloatArray, most: float) -> FloatArray:
        """Return a random unit vector at an angle of at most ``most`` [rad] to a given one."""
        side = self.rng.normal(size=3)
        side = unit(side - (side @ way) * way)
        angle = float(self.rng.uniform(0.3, 1.0)) * most
        return np.asarray(np.cos(angle) * way + np.sin(angle) * side)

    def poses(self, bend: float, flat: float = 1.0, common: float = 0.0) -> Swept:
        """Add a straight joint-space motion between two random smooth poses of an arm with a fixed base.

        Args:
            bend: maximum sum of the magnitudes of the joint angles of a pose [rad].
            flat: factor on the bend angles about the second axis.
            common: fraction of the joints, from the base, that do not move.

        Returns:
            The swept volume.

        Raises:
            UselessDraw: a joint bends too much.
        """
        self.fed = False
        arm = self.arm
        one, other = (smooth_bends(self.rng, arm, bend * float(self.rng.uniform(0.5, 1.0)), flat) for _ in range(2))
        shared = 2 * int(common * self.links)
        other[:shared] = one[:shared]
        if max(np.max(np.abs(one)), np.max(np.abs(other))) > MOST_BEND:
            raise UselessDraw
        self.legs.append(one + np.linspace(0.0, 1.0, 60)[:, None] * (other - one))
        self.stops.append(1)
        return Swept(arm, self.legs[0])
