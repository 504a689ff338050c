"""A constraint of a user, of which the pages speak: the camera at the tip looks at a valve."""

from typing import Any

import ccm_opt

VALVE = (2.0, 0.0)
"""Place of the valve [m]."""


@ccm_opt.constraint(lower=-1.0, where="motion")
def camera_sees_valve(q: Any) -> Any:
    """How far to the right of the tip the valve is [m]."""
    return VALVE[0] - q.tip[0]
