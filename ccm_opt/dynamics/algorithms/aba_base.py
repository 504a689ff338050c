"""What the base does under the whole articulated arm: it stands, or slides along the base heading under a thrust."""

from typing import Any

import casadi as ca


def base_step(state: Any, mass: Any, bias: Any) -> Any:
    """Function (state, thrust, world) -> ((ω̇, a) of the base, its acceleration along the feed).

    The whole arm pushes the base with f = M a + p, a less gravity; the thrust F is its component along x̂, the base
    heading: F = x̂ᵀ (M (a_feed x̂ − g) + p) is solved for a_feed.

    Args:
        state: symbol of what the last link inward passes on.
        mass: M in terms of it, (3, 3).
        bias: p in terms of it, (3,).
    """
    thrust = ca.SX.sym("thrust")
    world = ca.SX.sym("world", 5)
    slides = world[4]  # 1 or 0: a base that stands has no acceleration, whatever the thrust
    held = mass @ -world[:3] + bias
    feed = slides * (thrust - held[0]) / mass[0, 0]
    at_base = ca.vertcat(ca.DM.zeros(3), feed - world[0], -world[1], -world[2])
    return ca.Function("aba_base", [state, thrust, world], [at_base, feed])
