"""What rounding may take from a distance that the certificate reckons; derived in ``docs/theory.md``.

The verifier has its own bounds, on purpose.
"""

import numpy as np

from ccm_opt.freespace.workspace import Workspace
from ccm_opt.jointed.arm import Arm

UNIT = 2.0**-53
"""Half the distance from 1 to the next number."""


def proof_rounding(arm: Arm, workspace: Workspace, depth: int) -> float:
    """By how much a distance of an arm's axis from a wall, less its sag, may be off [m]; twice that between links.

    Args:
        arm: whose headings are at most those of joints that all bend by half a turn.
        workspace: its walls.
        depth: how often stretches are halved.
    """
    links = arm.links
    headings = abs(arm.base_heading) + np.pi * links
    # Headings are halved, sines are off by four units in the last place, and running sums of lengths lose digits.
    along = (depth + 1) * UNIT * headings + 8.0 * UNIT + 1.01 * (links + 2) * UNIT
    # The sag is a sum as well; turns of one interval are below a whole one, and an eighth of its square below five.
    of_sag = 1.01 * (links + 4) * UNIT * 5.0
    reach = float(np.max(np.abs(arm.base))) + arm.length
    size = max(2.0 * reach, float(np.max(np.abs(workspace.boundary.bounds))))
    return float(np.sqrt(2.0) * arm.length * along + arm.length * of_sag + 4.0 * UNIT * reach + 64.0 * UNIT * size)
