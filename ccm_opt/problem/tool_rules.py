"""Rules that an arm with a tool or other bodies on links must keep, by the keys of problem files."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import INERTIA_ROUNDING, RigidBody, second_moments
from ccm_opt.scene.tool_links import colliding_at_rest

Key = tuple[str | int, ...]
"""A key of a problem file, part by part."""


def tool_defects(arm: Arm, values: Mapping[Key, Any]) -> Iterator[tuple[Key, str]]:
    """Yield the key and a message for every value that an arm's tool and bodies do not allow.

    Args:
        arm: the arm.
        values: values of other keys of the problem; None, 0 or an empty list for those that are not given.
    """
    if not arm.rigid_bodies:
        return
    bodies: list[tuple[Key, RigidBody]] = [(("arm", "bodies", k), body) for k, body in enumerate(arm.bodies)]
    bodies += [] if arm.tool is None else [(("arm", "tool"), arm.tool)]
    key = bodies[0][0][:2]
    for not_with in _NOT_WITH_BODIES:
        if values.get(not_with):
            yield not_with, f"not supported together with {'.'.join(map(str, key))}"
    for only_with, only in _ONLY_WITH_BODIES:
        if values.get(only_with, only) != only:
            yield only_with, f"expected {only!r} together with {'.'.join(map(str, key))}"
    found = [defect for at, body in bodies for defect in _body_defects(body, at, arm)]
    yield from found
    if not found and (touching := colliding_at_rest(arm)) is not None:
        number, capsule, other = touching
        yield (
            (*bodies[number][0], "bodies", capsule),
            f"it touches or nearly touches {other} of the straight arm; keep a twentieth of both radii clear",
        )


def cover_notes(arm: Arm) -> list[str]:
    """Return a line for each remark on how capsules cover polygons and meshes of an arm's bodies."""
    bodies = [(f"arm.bodies[{k}]", body) for k, body in enumerate(arm.bodies)]
    bodies += [] if arm.tool is None else [("arm.tool", arm.tool)]
    return [f"{name}: {words}" for name, body in bodies for words in body.notes]


def _body_defects(body: RigidBody, at: Key, arm: Arm) -> Iterator[tuple[Key, str]]:
    """Yield the key and a message for a body on a link that there is not, in the mount, or with impossible mass."""
    arcs = arm.arcs
    if arcs is not None and not (arcs[body.link % arm.links] > 0.0 and arcs[body.link % arm.links + 1] == 0.0):
        yield at, "expected a section, and a place along it where an arc ends"
    elif not -arm.links <= body.link < arm.links:
        yield (*at, "link"), f"expected a link from 1 to {arm.links}, got {body.link + 1}"
    elif body.bodies and arm.free_shares[body.link] == 1.0:
        yield (*at, "bodies"), "its link belongs to the mount, which may touch obstacles, and bodies may not"
    yield from _mass_defects(body, at, arm.dimension)


def _mass_defects(body: RigidBody, at: Key, dimension: int) -> Iterator[tuple[Key, str]]:
    """Yield the key and a message for what makes mass and moments of inertia impossible."""
    if not (np.isfinite(body.mass) and body.mass >= 0.0):
        yield (*at, "mass"), f"expected a number, 0 or more, got {body.mass}"
    elif not body.mass:
        return
    if body.centre is not None and np.shape(body.centre) != (dimension,):
        yield (*at, "centre"), f"expected shape ({dimension},), got {np.shape(body.centre)}"
    if body.inertia is None:
        return
    if np.shape(body.inertia) != (3, 3) or not np.all(np.isfinite(body.inertia)):
        yield (*at, "inertia"), "expected finite moments of inertia of shape (3, 3)"
    elif np.linalg.eigvalsh(second_moments(body.inertia))[0] < -INERTIA_ROUNDING * np.trace(body.inertia):
        yield (*at, "inertia"), "no body has these moments of inertia: each is at most the sum of the other two"


def refuse_tool(arm: Arm, what: str) -> None:
    """Refuse an arm with a tool or other bodies where they are not supported.

    Args:
        arm: the arm.
        what: what does not support them, as the subject of a sentence.

    Raises:
        ProblemError: the arm has a tool or another body.
    """
    if arm.bodies:
        raise ProblemError(f"{what} does not support bodies on links; leave arm.bodies out")
    if arm.tool is not None:
        raise ProblemError(f"{what} does not support a tool; leave arm.tool out")


_NOT_WITH_BODIES: tuple[Key, ...] = (
    ("arm", "payload"),
    ("limits", "tip_velocity"),
    ("limits", "tip_acceleration"),
    ("limits", "points"),
    ("tolerance", "joint_error_deg"),
    ("planner", "follow_within"),
)
_ONLY_WITH_BODIES: tuple[tuple[Key, str], ...] = ((("planner", "method"), "nlp"),)
