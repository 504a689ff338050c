"""The numbers of free space, its routes and its corridors, in one place."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FreeSpaceSettings:
    """How finely free space is drawn, how many classes of paths are looked at, and how regions are chosen.

    Attributes:
        mitre_limit: distance of a grown corner's tangent, as a multiple of the inflation. Derived: with 1.02, turns
            below 22° need one vertex only, and nothing is given away but 2 % of the inflation.
        circle_quad_segs: sides of the polygon around a quarter of a circle; with 3, a circle becomes a 12-gon, 3.5 %
            wider at its vertices. Taste.
        corner_quad_segs: sides of the polygon round a quarter of a turn at corners, in place of tangents; 0 for
            tangents and circles of few vertices. Taste: with 24, only 0.06 % of the inflation is given away.
        dent: depth up to which dents of free space are filled, as a share of the inflation. Taste.
        edge_samples: points on each edge of the triangulation, ends included, between which paths are measured before
            any is drawn taut. Taste; a walk costs its square.
        route_surplus: classes that are drawn taut for each route wanted, at most. Taste.
        least_classes: but so many in any case: in near-empty rooms the sampled length is at its coarsest. Taste.
        sampled_excess: the sampled length of a class is at most this multiple of its taut length; mostly 1.01 in
            clutter. Taste, with room to spare.
        walks_per_route: partial walks looked at for each route wanted. Taste.
        least_routes: routes for which that effort is spent even if fewer are wanted. Taste.
        bisections: times that a straight piece which meets a wall is halved before the shortest walk is taken. Taste.
        walls_first: walls that are shut out of a growing region before the others are looked at; these usually hide
            all others, so the number moves the time only. Taste.
        corner_slack: share of the inflation by which a taut string may leave a corridor where it bends round a corner.
            Derived: less than 1, so that no obstacle fits in between.
        portal_width: width that a portal should have, as a share of the route's narrowest edge. Taste.
        portal_trials: crossings of the string at which a portal is tried, at most. Taste.
        overlap_thickness: least thickness of an overlap, as a share of the width that its portal should have. Taste.
        stations: evenly spaced sample places along a taut string, beside its vertices and crossings. Taste.
        arc_step: angle between points on an arc round a punctured base [rad]. Taste; the arc is drawn taut, only its
            class counts.
        arc_radius: radius of that arc as a share of how far the shorter path strays from the base. Taste; well inside
            every obstacle's gap.
        least_curl: an arm whose first link turns by more than this when the arm is drawn taut is curled round its base
            [rad]. Taste: well beyond how bends to and fro lie off the taut line.
        many_vertices: outlines of fewer vertices are not simplified. Taste.
        vertices_kept: outlines of which more than this share of the vertices would stay are left as they are. Taste.
        least_squareness: squareness that a chord is credited with where the string only touches it. Taste.
    """

    mitre_limit: float = 1.02
    circle_quad_segs: int = 3
    corner_quad_segs: int = 0
    dent: float = 0.02
    edge_samples: int = 7
    route_surplus: int = 6
    least_classes: int = 20
    sampled_excess: float = 1.25
    walks_per_route: int = 400
    least_routes: int = 4
    bisections: int = 6
    walls_first: int = 48
    corner_slack: float = 0.9
    portal_width: float = 0.5
    portal_trials: int = 6
    overlap_thickness: float = 0.2
    stations: int = 200
    arc_step: float = 0.3
    arc_radius: float = 1e-3
    least_curl: float = 2.4
    many_vertices: int = 100
    vertices_kept: float = 0.7
    least_squareness: float = 1e-3


DEFAULT_FREE_SPACE = FreeSpaceSettings()
"""The numbers that are used unless others are passed."""
FINE_FREE_SPACE = FreeSpaceSettings(corner_quad_segs=24, dent=0.0)
"""Many vertices, but next to nothing given away, where passages hardly let the arm through."""
