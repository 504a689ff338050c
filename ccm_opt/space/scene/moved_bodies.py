"""Bodies moved to another place, as they are turned."""

from dataclasses import replace

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.scene.bodies import Body, BoxBody, MeshBody, SphereBody
from ccm_opt.space.scene.rigid_placement import RigidPlacement


def moved_body(body: Body, by: FloatArray) -> Body:
    """A body that stands elsewhere.

    Args:
        body: any.
        by: how far it is moved, shape (3,) [m].
    """
    if isinstance(body, SphereBody):
        return replace(body, center=body.center + by)
    if isinstance(body, BoxBody):
        return replace(body, placement=_moved(body.placement, by))
    if isinstance(body, MeshBody):
        # Its vertices are in the room already.
        return replace(body, vertices=body.vertices + by, placement=_moved(body.placement, by))
    return replace(body, start=body.start + by, end=body.end + by)


def _moved(placement: RigidPlacement, by: FloatArray) -> RigidPlacement:
    return replace(placement, position=placement.position + by)
