"""What may be advised where room is short: only what the problem has to give."""

from ccm_opt.freespace.workspace import Workspace
from ccm_opt.jointed.arm import Arm


def room_advice(arm: Arm, workspace: Workspace) -> tuple[str, ...]:
    """How the arm itself could need less room: one line, or none for a bare axis that keeps no clearance."""
    keys = []
    if arm.radius > 0.0:
        keys.append("arm.radius")
    if workspace.clearance > 0.0:
        keys.append("workspace.clearance")
    return (f"use a smaller {' or '.join(keys)}",) if keys else ()
