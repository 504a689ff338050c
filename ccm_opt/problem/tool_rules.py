"""Rules that an arm with a tool must keep, by the keys of problem files."""

from collections.abc import Iterator, Mapping
from typing import Any

from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.tool_links import colliding_at_rest

Key = tuple[str | int, ...]
"""A key of a problem file, part by part."""


def tool_defects(arm: Arm, values: Mapping[Key, Any]) -> Iterator[tuple[Key, str]]:
    """Yield the key and a message for every value that an arm's tool does not allow.

    Args:
        arm: the arm.
        values: values of other keys of the problem; None, 0 or an empty list for those that are not given.
    """
    tool = arm.tool
    if tool is None:
        return
    if arm.dimension == 2 and arm.base_axes:
        yield ("arm", "tool"), "not supported for an arm in the plane with a feed axis"
    if arm.sections is not None:
        yield ("arm", "tool"), "not supported together with sections that bend evenly"
    if arm.carrier:
        yield ("arm", "tool"), "not supported together with arm.base.axes"
    for key in _NOT_WITH_A_TOOL:
        value = values.get(key)
        if value:
            yield key, "not supported together with arm.tool"
    for key, only in _ONLY_WITH_A_TOOL:
        if values.get(key, only) != only:
            yield key, f"expected {only!r} together with arm.tool"
    if (found := colliding_at_rest(arm, tool)) is not None:
        link, body = found
        yield (
            ("arm", "tool", "bodies", body),
            f"it touches or nearly touches link {link + 1} of the straight arm; keep a twentieth of both radii clear",
        )


def refuse_tool(arm: Arm, what: str) -> None:
    """Refuse an arm with a tool where tools are not supported.

    Args:
        arm: the arm.
        what: what does not support tools, as the subject of a sentence.

    Raises:
        ProblemError: the arm has a tool.
    """
    if arm.tool is not None:
        raise ProblemError(f"{what} does not support a tool; leave arm.tool out")


_NOT_WITH_A_TOOL: tuple[Key, ...] = (
    ("arm", "payload"),
    ("limits", "tip_velocity"),
    ("limits", "tip_acceleration"),
    ("limits", "points"),
    ("tolerance", "joint_error_deg"),
    ("planner", "follow_within"),
)
_ONLY_WITH_A_TOOL: tuple[tuple[Key, str], ...] = ((("planner", "method"), "nlp"),)
