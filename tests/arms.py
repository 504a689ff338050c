"""A plain arm for tests: equal links on a fixed base, and whatever a test wants otherwise."""

import numpy as np

from ccm_opt.robot.arm import Arm


def plain_arm(links: int = 6, link_length: float = 0.1, radius: float = 0.02, **changes: object) -> Arm:
    """An arm at the origin along x, without a mount; 0.1 kg a link, joints to 2 rad, the base all round."""
    values: dict[str, object] = {
        "links": links,
        "link_length": link_length,
        "radius": radius,
        "base": np.zeros(2),
        "base_heading": 0.0,
        "joint_limit": 2.0,
        "base_limit": 6.3,
        "self_collision": True,
        "mount_length": 0.0,
        "masses": np.full(links, 0.1),
        "inertia_axial": np.full(links, 3e-5),
        "inertia_transverse": np.full(links, 4e-5),
    }
    return Arm(**(values | changes))  # type: ignore[arg-type]
