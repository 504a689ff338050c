"""The chain of a URDF file as an arm of links on a line: lengths, radii, masses and limits, and what it simplifies."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path, PurePosixPath

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import file_length
from ccm_opt.io.mesh_obstacles import read_mesh_file
from ccm_opt.io.urdf import Inertial, Joint
from ccm_opt.io.urdf_bodies import Rounded, containing_radius, joined, rounded, standing_out
from ccm_opt.io.urdf_chain import JointedLine, PlacedLink, Revolute
from ccm_opt.problem import ImportedJoint
from ccm_opt.scene.bodies import RigidPlacement

EXACT = 1e-6
"""Deviation, as a fraction of lengths and masses or in radians, up to which nothing is reported. Derived: places and
angles written with six digits."""
LEAST_MASS = 1e-6
"""Mass of links without one where others have one [kg]. Heuristic: it loads no drive, and no simulation is
stiff."""
_SYMMETRIC = 0.05
"""Difference of the transverse moments of inertia over the greater up to which nothing is reported. Heuristic."""


@dataclass(frozen=True, eq=False)
class RobotMeshes:
    """Reader of the mesh files of a URDF.

    Attributes:
        folder: folder of the problem file.
        beside: folder of the URDF, relative to that.
        found: returns the path of a file that may be read, from its path relative to the problem file; None if not.
    """

    folder: Path
    beside: PurePosixPath
    found: Callable[[str], Path | None]

    def vertices(self, name: str, where: str) -> FloatArray:
        """Return the vertices of a mesh, shape (v, 3), in its own unit.

        Args:
            name: its file as written in the URDF: a path relative to it, or ``package://package/path``.
            where: the link, for messages.

        Raises:
            ProblemError: the file cannot be read.
        """
        scheme, _, rest = name.rpartition("://")
        package, _, inner = rest.partition("/")
        places = [self.beside / rest]
        if scheme == "package":
            places = [up / end for up, end in product((self.beside, self.beside.parent), (inner, rest))]
        there = next((place for place in places if (self.folder / place).is_file()), places[0])
        path = self.found(str(there))
        if path is None:
            raise ProblemError(f"{where}: its mesh '{name}' cannot be read")
        try:
            return read_mesh_file(path).vertices
        except ProblemError as error:
            within = f" (of the package '{package}')" if scheme == "package" else ""
            raise ProblemError(f"{where}: {error}{within}") from error


@dataclass(frozen=True, eq=False)
class UrdfArm:
    """The arm that a URDF describes, in SI units and the frame of its first joint.

    Attributes:
        line: the chain as an arm.
        in_space: whether the arm moves in three dimensions.
        meshes: reader of mesh files.
    """

    line: JointedLine
    in_space: bool
    meshes: RobotMeshes

    @cached_property
    def places(self) -> FloatArray:
        """Places of the joints and the tip along the arm, shape (links + 1,) [m].

        Raises:
            ProblemError: the last link has no length.
        """
        starts = [joint.place for joint in self.line.joints]
        place, _ = self._tip
        return np.array([*starts, place])

    @cached_property
    def _tip(self) -> tuple[float, str]:
        """Place of the tip along the arm [m], and what is there: the farthest frame fixed to the last link.

        Raises:
            ProblemError: there is none beyond the last joint and the link has no body, or it is off the arm's line.
        """
        last = self.line.joints[-1].place
        first, *fixed = self.line.chain.parts[-1]
        frames = [(self.line.along(each.placement.position), each) for each in fixed]
        beyond = [(point, each) for point, each in frames if point[0] > last * (1.0 + EXACT) + EXACT * self._extent]
        if beyond:
            point, each = max(beyond, key=lambda one: float(one[0][0]))
            off = float(np.hypot(point[1], point[2]))
            if off > 1e-3 * self._extent:
                raise ProblemError(
                    f"joint '{each.joint}': the frame '{each.link.name}' is {file_length(off, 4)} off the line of "
                    f"the arm; "
                    "expected the tip on it"
                )
            return float(point[0]), f"'{each.link.name}'"
        bodies = self._bodies([*self.line.chain.parts[-1]], last)
        if not bodies:
            raise ProblemError(f"link '{first.link.name}' has no length; expected a link fixed to it at the tip")
        return last + float(max(np.max(body.support(np.eye(3)[:1])) for body in bodies)), "the end of its bodies"

    @property
    def _extent(self) -> float:
        return max(self.line.joints[-1].place, 1e-9)

    @cached_property
    def lengths(self) -> FloatArray:
        """Length of each link, shape (links,) [m]."""
        return np.diff(self.places)

    def _in_link(self, placed: PlacedLink, place: float) -> RigidPlacement:
        """Return the placement of a link of the file in the frame of that of the arm which begins at ``place`` [m]."""
        here = self.line.along(placed.placement.position) - np.array([place, 0.0, 0.0])
        return RigidPlacement(here, self.line.frame.rotation.T @ placed.placement.rotation)

    def _bodies(self, links: Sequence[PlacedLink], place: float) -> list[Rounded]:
        found = []
        for placed in links:
            for shape in placed.link.collisions:
                vertices = None
                if shape.kind == "mesh":
                    own = self.meshes.vertices(shape.file, f"link '{placed.link.name}'")
                    vertices = own * np.array(shape.size)
                placement = shape.placement.placed(self._in_link(placed, place))
                found.append(rounded(shape, placement, vertices))
        return found

    @cached_property
    def bodies(self) -> list[list[Rounded]]:
        """Collision bodies of each link, in its frame."""
        rigid = [self._parts(k, turning=False) for k in range(len(self.line.joints))]
        return [self._bodies(links, joint.place) for links, joint in zip(rigid, self.line.joints, strict=True)]

    def _parts(self, k: int, *, turning: bool) -> list[PlacedLink]:
        """Return the links of the file that a link of the arm consists of, or those that turn against it at its joint.

        Args:
            k: index of the link of the arm.
            turning: whether to return the latter: those before a revolute that bends the arm.
        """
        joint = self.line.joints[k]
        bends = [slot in self.bent and self.limits[k, slot] > 0.0 for slot, each in enumerate(joint.revolutes) if each]
        parts = [part for number, part in enumerate(joint.parts) if any(bends[number + 1 :]) == turning]
        return [placed for part in parts for placed in self.line.chain.parts[part]]

    @cached_property
    def own_radii(self) -> FloatArray:
        """Radius of the capsule of each link that contains its bodies, shape (links,) [m]; NaN without bodies.

        Bodies that turn about its joint lie within a ball about the joint.
        """
        radii = np.full(len(self.lengths), np.nan)
        for k, joint in enumerate(self.line.joints):
            if self.bodies[k]:
                radii[k] = containing_radius(self.bodies[k], float(self.lengths[k]))
            if inner := self._bodies(self._parts(k, turning=True), joint.place):
                radii[k] = max(np.nan_to_num(radii[k]), containing_radius(inner, 0.0))
        return radii

    @cached_property
    def payload(self) -> float:
        """Point masses fixed at the tip [kg]."""
        return float(sum(each.link.inertial.mass for each in self._at_tip if each.link.inertial is not None))

    @cached_property
    def _at_tip(self) -> tuple[PlacedLink, ...]:
        tip, length = self.places[-1], float(self.lengths[-1])

        def is_point(placed: PlacedLink) -> bool:
            inertial = placed.link.inertial
            if inertial is None or placed.link.collisions:
                return False
            away = self.line.along(placed.placement.points(inertial.centre)) - np.array([tip, 0.0, 0.0])
            small = np.trace(inertial.inertia) <= EXACT * inertial.mass * length**2
            return bool(np.linalg.norm(away) <= EXACT * length and small)

        return tuple(each for each in self.line.chain.parts[-1][1:] if is_point(each))

    @cached_property
    def inertials(self) -> list[Inertial | None]:
        """Mass of each link in its frame, those between the revolutes of its joint included; None without mass."""
        found = []
        for joint in self.line.joints:
            links = [placed for part in joint.parts for placed in self.line.chain.parts[part]]
            parts = [
                (placed.link.inertial, self._in_link(placed, joint.place))
                for placed in links
                if placed.link.inertial is not None and placed not in self._at_tip
            ]
            found.append(joined(parts))
        return found

    @cached_property
    def limits(self) -> FloatArray:
        """Limits of the three revolutes of each joint, 0 where there is none, shape (links, 3) [rad].

        Raises:
            ProblemError: the range of a joint does not reach to both sides of zero.
        """
        limits = np.zeros((len(self.lengths), 3))
        for k, joint in enumerate(self.line.joints):
            for slot, revolute in enumerate(joint.revolutes):
                limits[k, slot] = (
                    0.0 if revolute is None else _symmetric(revolute.joint, 2.0 * np.pi if k == 0 else np.pi)
                )
        return limits

    @property
    def bent(self) -> tuple[int, ...]:
        """Which of the revolutes of a joint bend the arm."""
        return (0, 1) if self.in_space else (1,)

    @property
    def imported(self) -> Iterator[ImportedJoint]:
        """Joints of the file, from the base outward."""
        count = len(self.line.joints)
        if self.line.feed is not None:
            yield ImportedJoint(self.line.feed.joint.name, 3 * count, self.line.feed.sense, held=False)
        for k, slot, revolute in self._revolutes():
            yield ImportedJoint(revolute.joint.name, 3 * k + slot, revolute.sense, held=slot not in self.bent)

    def _revolutes(self) -> Iterator[tuple[int, int, Revolute]]:
        for k, joint in enumerate(self.line.joints):
            for slot, revolute in enumerate(joint.revolutes):
                if revolute is not None:
                    yield k, slot, revolute

    def notes(self) -> Iterator[str]:
        """Yield what was left out, simplified or made larger."""
        yield from self._kept_notes()
        yield from self._shape_notes()
        yield from self._mass_notes()

    def _kept_notes(self) -> Iterator[str]:
        yield f"the tip is {self._tip[1]}"
        held = [each.name for each in self.imported if each.held]
        if held:
            yield f"{listed_names(held)} {'stay' if len(held) > 1 else 'stays'} at 0, as the arm has no such bend"
        cut = [each.joint for _, slot, each in self._revolutes() if slot in self.bent and _cut(each.joint) is not None]
        if cut:
            ranges = [f"{joint.name} {_cut(joint)}" for joint in cut[:3]]
            rest = f", and {len(cut) - 3} more" if len(cut) > 3 else ""
            yield f"ranges are cut to the smaller side of 0: {', '.join(ranges)}{rest}"
        dry = [each.joint.name for _, _, each in self._revolutes() if each.joint.friction]
        if dry:
            yield f"dry friction of {listed_names(dry)} is not counted"

    def _shape_notes(self) -> Iterator[str]:
        line = self.line
        if line.askew > EXACT or line.aside > EXACT * self.places[-1]:
            reach = self.places[-1] - self.places[:-1]
            most = line.aside + line.askew * float(np.sum(reach))
            yield (
                f"axes are set straight by up to {np.rad2deg(line.askew):.2g}° and {file_length(line.aside, 2)}: "
                f"places along "
                f"the arm differ from the file's by up to {file_length(most, 2)}"
            )
        fixed = [placed.link.name for part in line.chain.parts[: line.joints[0].parts[0]] for placed in part]
        solid = {placed.link.name for part in line.chain.parts for placed in part if placed.link.collisions}
        still = [name for name in fixed if name in solid]
        if still:
            yield f"bodies of {listed_names(still)} are no part of the arm; give them as obstacles where they matter"
        outs = {
            line.chain.parts[joint.parts[-1]][0].link.name: standing_out(bodies, float(length), float(radius))
            for joint, bodies, length, radius in zip(
                line.joints, self.bodies, self.lengths, self.own_radii, strict=True
            )
            if bodies
        }
        if outs and max(outs.values()) > EXACT * float(self.places[-1]):
            worst = max(outs, key=lambda name: outs[name])
            usual = float(np.median([out if out > EXACT * float(self.places[-1]) else 0.0 for out in outs.values()]))
            yield (
                f"capsules stand out from the bodies of links by up to {file_length(outs[worst], 3)} (link '{worst}'), "
                f"{file_length(usual, 3)} in the median"
            )

    def _mass_notes(self) -> Iterator[str]:
        names = [self.line.chain.parts[joint.parts[-1]][0].link.name for joint in self.line.joints]
        known = [
            (name, each, float(length)) for name, each, length in zip(names, self.inertials, self.lengths, strict=True)
        ]
        without = [name for name, each, _ in known if each is None]
        if without and len(without) < len(known):
            yield f"{listed_names(without)} without mass: taken as {LEAST_MASS:g} kg"
        off = {
            name: float(np.linalg.norm(each.centre - np.array([0.5 * length, 0.0, 0.0])))
            for name, each, length in known
            if each is not None
        }
        far = [name for name, _, length in known if off.get(name, 0.0) > 1e-3 * length]
        if far:
            worst = max(far, key=lambda name: off[name])
            yield (
                f"centres of mass are set to the middles of links, from up to {file_length(off[worst], 3)} away (link "
                f"'{worst}'): torques of gravity differ accordingly"
            )
        uneven = [name for name, each, _ in known if each is not None and _unevenness(each.inertia) > _SYMMETRIC]
        if uneven:
            yield f"moments of inertia of {listed_names(uneven)} are taken as equal across the link, their mean"
        carried = [placed for part in self.line.chain.parts[1 : self.line.joints[0].parts[0]] for placed in part]
        heavy = sum(placed.link.inertial.mass for placed in carried if placed.link.inertial is not None)
        if heavy > LEAST_MASS:
            yield f"the mass of what the feed axis carries besides the arm, {heavy:.4g} kg, is not counted in its force"


def _unevenness(inertia: FloatArray) -> float:
    """Return how far the moments of inertia are from being symmetric about x, as a fraction of the greatest."""
    across = inertia[1:, 1:]
    off = max(abs(across[0, 0] - across[1, 1]), 2.0 * abs(across[0, 1]), 2.0 * float(np.max(np.abs(inertia[0, 1:]))))
    return float(off / max(float(np.max(np.abs(inertia))), 1e-300))


def listed_names(names: Sequence[str]) -> str:
    """Return quoted names in words, at most three and the number of the others."""
    shown = ", ".join(f"'{name}'" for name in names[:3])
    return f"{shown} and {len(names) - 3} more" if len(names) > 3 else shown


def _symmetric(joint: Joint, most: float) -> float:
    """Return the limit of the absolute angle of a revolute, at most that of a full turn to either side [rad].

    Raises:
        ProblemError: its range does not reach to both sides of zero.
    """
    if joint.lower == joint.upper == 0.0:
        return 0.0
    limit = min(-joint.lower, joint.upper)
    if limit <= 0.0:
        span = f"{np.rad2deg(joint.lower):.4g}° to {np.rad2deg(joint.upper):.4g}°"
        raise ProblemError(
            f"joint '{joint.name}': its range, {span}, does not reach to both sides of 0, where the arm is straight; "
            f"expected "
            "limits on the absolute angle"
        )
    return float(min(limit, most))


def _cut(joint: Joint) -> str | None:
    """Return how the range of a revolute was cut, in degrees; None if it is symmetric."""
    if -joint.lower == joint.upper or abs(joint.lower + joint.upper) <= EXACT:
        return None
    low, high = np.rad2deg(joint.lower), np.rad2deg(joint.upper)
    return f"[{low:.4g}, {high:.4g}]° to ±{min(-low, high):.4g}°"
