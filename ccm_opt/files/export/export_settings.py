"""Sizes of what is written for other programs, where the problem does not give them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ExportSettings:
    """Sizes of exported scenes and films; all of them are taste but where it says otherwise.

    Attributes:
        depth: of extruded obstacles behind and before the plane, in radii of the arm: as the viewer shows them.
        least_depth: the same at least, as a share of the arm's length; arms without a radius need it.
        room_wall: thickness of the walls around the room, as a share of the arm's length.
        thin_wall: thickness of walls that have none, as a share of the arm's length. Derived: what a contact may be
            off by unless the problem says otherwise, since engines know no walls without thickness.
        round_sides: sides of cylinders and half spheres in films.
        glass: opacity of bodies in films in space, which would hide the arm otherwise.
        film_rate: keyframes of films a second [1/s]; between them players interpolate.
        compression: of arrays, from 1, fast, to 9, small. Measured on the plan of the swan's neck, 1.37 MB without:
            615 kB in 14 ms at 1, 612 kB in 24 ms at 6.
    """

    depth: float = 4.0
    least_depth: float = 0.02
    room_wall: float = 0.05
    thin_wall: float = 1e-6
    round_sides: int = 16
    glass: float = 0.35
    film_rate: float = 30.0
    compression: int = 1


EXPORT = ExportSettings()
"""Used where no other settings are given."""
