"""SCM-2 and SCM-8: from one curvature to another by interpolation (section 4.2)."""

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.decomposition import interpolate
from ccm_opt.ground.angles import heading_of, whole_turns, wrap
from ccm_opt.hill_climbing.candidate_moves import Shapes
from ccm_opt.hill_climbing.climbing_settings import SchemaSettings
from ccm_opt.hill_climbing.steps import Schema, SchemaStep, SchemaStopped
from ccm_opt.hill_climbing.world import World


def scm_2(world: World, start: Configuration, target: Configuration) -> Schema:
    """SCM-2: move by interpolation from the current curvature to one selected by SCM-1.

    Keeps base and length; base rotation and curvature go straight to those of the target.

    Args:
        world: the world.
        start: where the arm is.
        target: a configuration of the same base and length.

    Yields:
        Configurations evenly on the way.

    Returns:
        The target.

    Raises:
        SchemaStopped: something is in the way.
    """
    here = start
    for share in _shares(start, target, world.settings.schemas):
        there = interpolate(start, target, share)
        if not world.move_allowed(here, there):
            raise SchemaStopped("SCM-2", here, f"contact after {share:.0%} of the way to the selected curvature")
        here = there
        yield SchemaStep("SCM-2", here)
    return here


def scm_8(world: World, start: Configuration, target: Configuration, *, as_far_as_free: bool = False) -> Schema:
    """SCM-8: SCM-2 while the direction of the vector from base to tip is preserved.

    The base turns so that it is; the target's own base rotation is not kept.

    Args:
        world: the world.
        start: where the arm is.
        target: a configuration of the same base and length.
        as_far_as_free: end before a contact instead of stopping there.

    Yields:
        Configurations on the way.

    Returns:
        The target, turned about the base, or the last configuration before a contact.

    Raises:
        SchemaStopped: something is in the way.
    """
    here = start
    direction = direction_to_tip(world, start)
    for share in _shares(start, target, world.settings.schemas):
        mixed = interpolate(start, target, share)
        # First the direction is restored, then the winding that the base has.
        there = turned(mixed, wrap(direction - direction_to_tip(world, mixed)))
        there = turned(there, whole_turns(here.base_heading - there.base_heading))
        if not world.move_allowed(here, there):
            if as_far_as_free and here is not start:
                return here
            raise SchemaStopped("SCM-8", here, f"contact after {share:.0%} of the way to the selected curvature")
        here = there
        yield SchemaStep("SCM-8", here)
    return here


def turned(configuration: Configuration, angle: float) -> Configuration:
    """A configuration turned about its base [rad]."""
    shapes = Shapes.from_configurations([configuration])
    shapes.heading[0] += angle
    return shapes.configuration(0)


def direction_to_tip(world: World, configuration: Configuration) -> float:
    """Direction of the vector from base to tip [rad]."""
    (tip,), _ = world.tips(Shapes.from_configurations([configuration]))
    return heading_of(tip - configuration.base)


def _shares(start: Configuration, target: Configuration, settings: SchemaSettings) -> list[float]:
    """Shares of the way at which no heading has changed by more than the stride since the last."""
    arc = np.linspace(0.0, start.length, settings.stride_samples)
    most = float(np.abs(target.heading_at(arc) - start.heading_at(arc)).max())
    count = max(1, int(np.ceil(most / settings.stride)))
    return [k / count for k in range(1, count + 1)]
