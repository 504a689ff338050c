"""Arms from URDF files: the file of the key ``arm.urdf`` becomes the other keys of ``[arm]``, and of ``[limits]``."""

from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import METRES, LengthUnit, in_unit, words_in
from ccm_opt.io.build_arm import each_revolute
from ccm_opt.io.drawing import read_drawing, resolve_file
from ccm_opt.io.issues import Issues, KeyPath
from ccm_opt.io.urdf import read_urdf
from ccm_opt.io.urdf_chain import Revolute, jointed_line, moving_chain
from ccm_opt.io.urdf_links import EXACT, LEAST_MASS, RobotMeshes, UrdfArm, listed_names
from ccm_opt.problem import ImportedArm
from ccm_opt.robot.link_bodies import cylinder_inertia

EXPECTED = "a URDF, for example 'arm.urdf'"
_MOST_BYTES = 4 * 2**20
"""Greatest size of a URDF [bytes]. Heuristic: a hundred times that of usual ones."""
_SAID = ("sections", "links", "link_length", "joint_limit_deg", "base_limit_deg")
"""Keys of ``[arm]`` that a URDF always says."""
_STRUCTURE = {"velocity": 1e3, "torque": 1e6}
"""Limits of revolutes that the URDF does not have, whose torques the structure bears [rad/s, N m]."""
_UNLIMITED = {"velocity": 1e3, "torque": 1e6}
"""Limits of a URDF from which on there is none, as URDF cannot say so [rad/s or m/s, N m or N]."""


def with_urdf(
    data: Mapping[str, object], folder: Path | None, issues: Issues, *, in_space: bool, allow_outside: bool = False
) -> tuple[Mapping[str, object] | None, ImportedArm | None]:
    """Return a parsed problem file with the arm's URDF replaced by the keys that it says.

    Args:
        data: the parsed problem file.
        folder: folder to which the URDF's path is relative; None if the data come from no file.
        issues: receives the defects of the URDF, and of keys that contradict it.
        in_space: whether the arm moves in three dimensions.
        allow_outside: whether the URDF and its meshes may lie outside ``folder``.

    Returns:
        First the data, unchanged without the key ``arm.urdf``; None if the URDF has defects. Second the report; None
        without the key.
    """
    arm = data.get("arm")
    if not isinstance(arm, Mapping) or "urdf" not in arm:
        return data, None
    unit: LengthUnit = str(data.get("units", "m"))  # type: ignore[assignment]
    path: KeyPath = ("arm", "urdf")
    file = arm["urdf"]
    before = len(issues.found)
    for key in _SAID:
        if key in arm:
            issues.add(("arm", key), "not together with arm.urdf, which says it; leave one of them out")
    if not isinstance(file, str) or not file:
        issues.add(path, f"expected the path of {EXPECTED}")
        return None, None
    place = resolve_file(file, folder, path, EXPECTED, issues, allow_outside=allow_outside)
    if place is None or folder is None or len(issues.found) > before:
        return None, None

    def found(name: str) -> Path | None:
        return resolve_file(name, folder, path, "a mesh", issues, allow_outside=allow_outside)

    try:
        with words_in(unit if unit in METRES else "m"):
            content = read_drawing(place, (".urdf", ".xml"), "URDF", _MOST_BYTES, b" \t\r\n")
            line = jointed_line(moving_chain(read_urdf(content)), in_space=in_space)
            read = UrdfArm(line, in_space, RobotMeshes(folder, PurePosixPath(file).parent, found))
            whole = _written(read, data, unit if unit in METRES else "m", issues)
            notes = tuple(read.notes())
    except ProblemError as error:
        issues.add(path, f"{file}: {error}")
        return None, None
    return (whole if len(issues.found) == before else None), ImportedArm(file, tuple(read.imported), notes)


def _written(arm: UrdfArm, data: Mapping[str, Any], unit: LengthUnit, issues: Issues) -> Mapping[str, object]:
    """Return a parsed problem file with the keys that a URDF says, in the file's unit; contradictions are reported."""
    given = {key: value for key, value in data["arm"].items() if key != "urdf"}
    lengths = [_as_written(length, unit) for length in arm.lengths]
    if min(arm.lengths) <= 0.0:
        raise ProblemError("a link has no length")
    radii = _radii(arm, given, unit, issues)
    given.pop("radius", None)
    sections: list[dict[str, object]] = []
    for k, (length, radius, limits) in enumerate(zip(lengths, radii, arm.limits[:, arm.bent], strict=True)):
        row: dict[str, object] = {"links": 1, "link_length": length, "radius": radius}
        row["joint_limit_deg"] = _pair(np.rad2deg(np.minimum(limits, np.pi))) if np.any(limits) else 90.0
        sections.append(row if np.any(limits) else {**row, "locked": [1]})
        if k == 0 and np.any(limits):
            given["base_limit_deg"] = _pair(np.rad2deg(limits))
    _weigh(arm, given, issues)
    damping = np.zeros((len(lengths), 3))
    for k, slot, revolute in arm._revolutes():  # noqa: SLF001 - of this module
        damping[k, slot] = revolute.joint.damping
    if np.any(damping):
        _say(given, "friction", damping.ravel().tolist(), issues)
    limits_given = data.get("limits")
    rates = dict(limits_given) if isinstance(limits_given, Mapping) else {}
    for key, attribute in (("velocity", "velocity"), ("torque", "effort")):
        _limit(arm, rates, key, attribute)
    if arm.line.feed is not None:
        _feed(arm.line.feed, given, rates, unit, issues)
    _place(arm, given, unit, issues)
    return {**data, "arm": {**given, "sections": sections}, "limits": rates}


def _as_written(length: float, unit: LengthUnit) -> float:
    """Return a length [m] in the file's unit, rounded so that links meant to be equal are."""
    return float(f"{in_unit(length, unit):.12g}")


def _pair(limits: FloatArray) -> float | list[float]:
    return limits.tolist() if np.ptp(limits) else float(limits[0])


def _say(arm: dict[str, Any], key: str, value: object, issues: Issues) -> None:
    """Set a key of ``[arm]`` to what the URDF says, or report that the file gives it too."""
    if key in arm:
        issues.add(("arm", key), "not together with arm.urdf, which says it; leave it out")
    arm[key] = value


def _radii(arm: UrdfArm, given: Mapping[str, Any], unit: LengthUnit, issues: Issues) -> list[float]:
    radii = arm.own_radii
    bare = [arm.line.chain.parts[joint.parts[-1]][0].link.name for joint in arm.line.joints]
    bare = [name for name, radius in zip(bare, radii, strict=True) if np.isnan(radius)]
    own = given.get("radius")
    if own is not None and not bare:
        issues.add(("arm", "radius"), "not together with arm.urdf, whose links all have collision bodies; leave it out")
    elif bare and not (isinstance(own, (int, float)) and not isinstance(own, bool) and own >= 0.0):
        issues.add(
            ("arm", "radius"), f"expected the radius of links of the URDF without collision body: {listed_names(bare)}"
        )
        own = 0.0
    return [float(own or 0.0) if np.isnan(radius) else _as_written(radius, unit) for radius in radii]


def _weigh(arm: UrdfArm, given: dict[str, Any], issues: Issues) -> None:
    """Set masses and moments of inertia of links; without any in the URDF those of the file remain."""
    if arm.payload:
        _say(given, "payload", arm.payload, issues)
    if all(each is None for each in arm.inertials):
        return
    for key in ("link_mass", "masses", "inertia"):
        if key in given:
            issues.add(("arm", key), "not together with arm.urdf, which says it; leave it out")
    masses = np.array([LEAST_MASS if each is None else each.mass for each in arm.inertials])
    radii = np.nan_to_num(arm.own_radii)
    axial, transverse = cylinder_inertia(masses, radii, arm.lengths)
    for k, each in enumerate(arm.inertials):
        if each is not None and np.trace(each.inertia) > 0.0:
            # Flat or thin bodies may have none about the axis of the link, where its drive must not run away.
            axial[k] = max(each.inertia[0, 0], 1e-12)
            transverse[k] = max(0.5 * (each.inertia[1, 1] + each.inertia[2, 2]), 1e-12)
    given.pop("link_mass", None)
    given["masses"] = masses.tolist()
    given["inertia"] = {"axial": axial.tolist(), "transverse": transverse.tolist()}


def _limit(arm: UrdfArm, rates: dict[str, Any], key: str, attribute: str) -> None:
    """Set a limit of every revolute to the stricter of those in the URDF and in the file.

    Raises:
        ProblemError: some joints of the URDF have no velocity, and the file gives none.
    """
    count = len(arm.lengths)
    own = np.full((count, 3), np.inf)
    needed = np.zeros((count, 3), dtype=bool)
    lacking = ""
    for k, slot, revolute in arm._revolutes():  # noqa: SLF001 - of this module
        value = getattr(revolute.joint, attribute)
        needed[k, slot] = slot in arm.bent
        own[k, slot] = value if 0.0 < value < _UNLIMITED[key] else np.inf
        if needed[k, slot] and np.isinf(own[k, slot]):
            lacking = lacking or revolute.joint.name
    given = rates.get(key)
    if given is not None:
        values = np.asarray(given, dtype=np.float64) if _are_numbers(given) else np.zeros(0)
        if values.shape not in {(), (count,), (3 * count,)}:
            return  # reported with the other keys
        own = np.minimum(own, each_revolute(given, count).reshape(count, 3))
    if not np.any(np.isfinite(own[needed])):
        return
    if key == "velocity" and not np.all(np.isfinite(own[needed])):
        raise ProblemError(f"joint '{lacking}' has no velocity, as others have; give limits.velocity")
    rates[key] = np.where(np.isfinite(own), own, _STRUCTURE[key]).ravel().tolist()


def _are_numbers(value: object) -> bool:
    listed = value if isinstance(value, list) else [value]
    return all(isinstance(each, (int, float)) and not isinstance(each, bool) for each in listed)


def _feed(slide: Revolute, given: dict[str, Any], rates: dict[str, Any], unit: LengthUnit, issues: Issues) -> None:
    """Set the feed axis of ``[arm]``, and its limits; the file may say where its guide tube ends."""
    joint = slide.joint
    if not (np.isfinite(joint.lower) and np.isfinite(joint.upper) and joint.lower < joint.upper):
        raise ProblemError(f"joint '{joint.name}' has no range; expected lower < upper")
    ends = sorted((slide.sense * joint.lower, slide.sense * joint.upper))
    feed = given.get("feed", {})
    if isinstance(feed, Mapping):
        if "range" in feed:
            issues.add(("arm", "feed", "range"), "not together with arm.urdf, which says it; leave it out")
        given["feed"] = {**feed, "range": [in_unit(end, unit) for end in ends]}
    for key, value, unlimited in (
        ("feed_velocity", in_unit(joint.velocity, unit), _UNLIMITED["velocity"] / METRES[unit]),
        ("feed_force", joint.effort, _UNLIMITED["torque"]),
    ):
        own = rates.get(key, np.inf)
        if 0.0 < value < unlimited and _are_numbers(own):
            rates[key] = float(min(value, own))


def _place(arm: UrdfArm, given: dict[str, Any], unit: LengthUnit, issues: Issues) -> None:
    """Set the place of the first joint, unless the file gives it: that in the frame of the URDF's root."""
    frame = arm.line.frame
    if arm.line.axes != "zyx":
        _say(given, "axes", arm.line.axes, issues)
    if "base" in given:
        return
    x, y, z = frame.rotation.T
    place = [in_unit(value, unit) for value in frame.position]
    if arm.in_space:
        given["base"] = {"position": place, "direction": x.tolist(), "up": z.tolist()}
    elif abs(y[1]) < 1.0 - EXACT:
        issues.add(("arm", "base"), "missing; the arm of the URDF does not lie in its x-z plane, which would say it")
    else:
        given["base"] = [place[0], place[2]]
        _say(given, "base_heading_deg", float(np.rad2deg(np.arctan2(x[2], x[0]))), issues)
