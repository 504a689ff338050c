"""What may be advised where room is short or joints are at their limits: only what the problem has to give."""

import numpy as np

from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm


def room_advice(arm: Arm, workspace: Workspace) -> tuple[str, ...]:
    """How the arm itself could need less room: one line, or none for a bare axis that keeps no clearance."""
    keys = []
    if arm.radius > 0.0:
        keys.append("arm.radius")
    if workspace.clearance > 0.0:
        keys.append("workspace.clearance")
    return (f"use a smaller {' or '.join(keys)}",) if keys else ()


AT_LIMIT = 0.99
"""Share of its limit from which on a joint counts as held by it. Taste."""
MOST_NAMED = 6
"""Joints that are named one by one. Taste."""


def joints_at_limits(bends: FloatArray, limits: FloatArray) -> tuple[str, tuple[str, ...]]:
    """Return which joints of a pose are held by their limits, in words, and what is advised; both may be empty.

    Args:
        bends: of each joint, shape (links,), or in space (links, 2) [rad].
        limits: of them, likewise [rad].
    """
    bent = np.abs(bends.reshape(len(bends), -1))
    allowed = limits.reshape(bent.shape)
    held = np.flatnonzero((bent >= AT_LIMIT * allowed).any(axis=1)) + 1
    if len(held) == 0:
        return "", ()
    named = ", ".join(str(number) for number in held[:MOST_NAMED])
    more = f" and {len(held) - MOST_NAMED} more" if len(held) > MOST_NAMED else ""
    which = f"joint {named}" if len(held) == 1 else f"joints {named}{more}"
    limit = float(np.rad2deg(allowed[held[-1] - 1].max()))
    words = f"{which} bent to the limit of {limit:.4g}°"
    keys = [
        key for key, joints in (("arm.base_limit_deg", held == 1), ("arm.joint_limit_deg", held > 1)) if joints.any()
    ]
    return words, tuple(f"raise {key}: where the best attempt ended, it holds {which}" for key in keys)
