"""A scene while it is drawn around its witness."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.cli.compare.space_clutter import arm_of_links
from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, RigidPlacement

from .space_shapes import ORIGIN, Bodies, Route, UselessDraw, bands, outline_about, sheet, thick_plate, unit
from .witness_motions import MOST_BEND, Swept, followed, smooth_bends

IN_TUBE = 0.05
"""How far the tip is inside the guide tube at a start inside [m]."""
Z = np.eye(3)[2]


@dataclass(eq=False)
class Drawing:
    """A scene while it is drawn: guide tube or base at the origin, along x.

    Attributes:
        rng: source of all draws.
        links: number of links.
        start: "inside" the guide tube or fed "out".
        length: of the arm [m].
        radius: of the arm [m].
        legs: rows of configurations of motions one after the other, the last row of one the first of the next.
        stops: numbers of the legs at whose ends there is a goal.
        bodies: by their names.
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
        """The arm with joints that bend as far as any witness."""
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
        """Length of the straight beginning of routes: nothing bends before a link is out of the tube [m]."""
        return self.link + float(self.rng.uniform(0.01, 0.04))

    def bend(self) -> float:
        """Radius of bends that the arm follows [m]."""
        return max(0.08, 1.3 * self.link) * float(self.rng.uniform(1.0, 1.3))

    def room(self) -> float:
        """Room about the witness [m]."""
        return float(self.rng.uniform(0.0042, 0.011))

    def go(self, route: Route, end: float | None = None, begin: float | None = None) -> Swept:
        """Follow a route from a tip's arc length, or from the start, to another and let there be a goal."""
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
        """Place so many bodies about everything that is swept."""
        swept = Swept(self.arm, np.concatenate(self.legs))
        for k, body in enumerate(swept.strew(self.rng, draw, count, self.room)):
            self.bodies[f"{name} {k}"] = body

    def bar(self, low: float, high: float, radius: float) -> CapsuleBody:
        """Draw a bar of a length between two about the origin [m]."""
        half = 0.5 * float(self.rng.uniform(low, high)) * unit(self.rng.normal(size=3))
        return CapsuleBody(-half, half, radius)

    def block(self, low: float, high: float) -> BoxBody:
        """Draw a box with sides between two lengths about the origin [m]."""
        half = 0.5 * self.rng.uniform(low, high, 3)
        return BoxBody(-half, half, RigidPlacement.of_quaternion(ORIGIN, self.rng.normal(size=4)))

    def jagged(self, size: float) -> Body:
        """Draw a closed mesh of a size about the origin [m]."""
        rings = [r * outline_about(z * Z, Z, 1.0, square=False) + (1.0 - r) * z * Z for r, z in self._profile(size)]
        return sheet(*bands(rings, closed=True), solid=True)

    def _profile(self, size: float) -> list[tuple[float, float]]:
        """Radii and heights of a ring with a section of three corners [m]."""
        wide = size * float(self.rng.uniform(0.3, 0.5))
        return [(0.5 * wide, 0.0), (wide, 0.3 * size), (wide, -0.3 * size)]

    def plate(self, name: str, place: FloatArray, normal: FloatArray, swept: Swept, half: float) -> None:
        """Put a plate with a hole where the witness passes."""
        middle, hole = swept.opening(place, normal, self.room())
        thick = float(self.rng.uniform(0.001, 0.003))
        outline = outline_about(place, normal, half)
        self.bodies[name] = thick_plate(middle, normal, hole + 0.5 * thick, outline, thick)

    def tilted(self, way: FloatArray, most: float) -> FloatArray:
        """Draw a direction within an angle of another [rad]."""
        side = self.rng.normal(size=3)
        side = unit(side - (side @ way) * way)
        angle = float(self.rng.uniform(0.3, 1.0)) * most
        return np.asarray(np.cos(angle) * way + np.sin(angle) * side)

    def poses(self, bend: float, flat: float = 1.0, common: float = 0.0) -> Swept:
        """Move straight from one smooth pose to another, which share the first part of the arm, and let be a goal."""
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
