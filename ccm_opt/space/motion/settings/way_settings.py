"""Numbers of the ways that the tip may take.

Lengths are in nominal links u = L / 24 unless said otherwise.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class WaySettings:
    """Of the ways that the tip may take.

    Attributes:
        cells: of the grids that they are looked for in, the coarse one first.
        finest: size that their cells have at least [u].
        nearness: what a way along a wall costs more than one far away, as a multiple; tried in turn.
        margins: shares of the margin with which the grid is free; tried in turn until there is a way.
        close: share of the margin that steps keep where the whole of it has failed.
        approaches: lengths of the straight end along the wanted direction, tried in turn [u].
        shortcut_gap: room that straight parts keep where corners are cut [u].
        far: distance from which on walls do not make a way dearer [u].
        detour_price: what a way costs more near one that has failed, as a multiple.
        detours: ways that keep away from those before, at most.
        around: how far beyond everything in the scene ways may go [u]; there is nothing to go round farther out.
    """

    cells: tuple[int, ...] = (200_000, 1_500_000, 8_000_000)
    finest: float = 0.12
    nearness: tuple[float, ...] = (3.0, 20.0)
    margins: tuple[float, ...] = (1.0, 0.0)
    close: float = 0.4
    approaches: tuple[float, ...] = (3.0, 0.0, 1.5, 6.0)
    shortcut_gap: float = 0.5
    far: float = 2.0
    detour_price: float = 4.0
    detours: int = 3
    around: float = 4.0


@dataclass(frozen=True)
class FollowableWaySettings:
    """Of ways that an arm can follow behind its tip, with bends no sharper than it takes.

    Attributes:
        tightest: radius of the tightest bend [u]; the least where knots of the curve still show a right angle.
        limit_shares: radii that are counted on, as multiples of that of the circle through the joints of an arm which
            bends as far as it may; tried in turn. The circle that its links touch has a radius of cos(limit / 2) of
            that, 0.71 for right angles: with less than the whole, links reach out of a bend on both sides.
        apart: a radius is tried beside others if it is less than this share of each that is greater, and they of it.
        step: length of the arcs of which a way is made [u].
        bends: of the arcs, as shares of the tightest one; straight ones come first.
        azimuths: towards which arcs bend.
        bend_price: what the tightest bend costs more than a straight way, as a multiple.
        place_bin: states in one bin count as one: size of its places [u].
        direction_bins: half the number of bins along each side of the six faces of directions.
        landing: from how near two arcs to the goal are tried [u].
        longest_landing: these two may be longer than the straight line by this multiple.
        most_states: that are looked at.
        spare_length: by how much a way may be longer than what an arm can be fed [u].
        cells: of the grids that they are looked for in, in turn.
        approaches: lengths of the straight end along the wanted direction, tried in turn; in nominal links, or in links
            where these are longer.
        prices: tried in turn: what a way along a wall costs more than one far away, as a multiple, and the share of the
            margin with which the grid is free.
    """

    tightest: float = 1.5
    limit_shares: tuple[float, ...] = (1.15, 0.75, 1.6)
    apart: float = 0.9
    step: float = 1.0
    bends: tuple[float, ...] = (0.5, 1.0)
    azimuths: int = 8
    bend_price: float = 1.0
    place_bin: float = 0.5
    direction_bins: int = 2
    landing: float = 6.0
    longest_landing: float = 1.6
    most_states: int = 20_000
    spare_length: float = 2.0
    cells: tuple[int, ...] = (200_000, 1_500_000)
    approaches: tuple[float, ...] = (1.0, 0.0)
    prices: tuple[tuple[float, float], ...] = ((3.0, 1.0), (1.0, 0.0))


@dataclass(frozen=True)
class SlideSettings:
    """Of arms that are slid along a way of the tip with all joints on it.

    Attributes:
        step: of the feed from keyframe to keyframe [u].
        knots: of the curve, tried in turn: the more, the better it shows sharp bends, and the longer the optimisation
            takes (measured in pipes: with 8 to 16 links 16 show what chords leave, with 24 links 22 do).
        grazing: a motion led by the tip that keeps less than this share of the wanted gap is slid instead if it can be;
            the optimisation seldom makes room for such a one.
        room: share of the wanted gap that the first fit of these leaves; where none does, any that touches nothing.
    """

    step: float = 0.5
    knots: tuple[int, ...] = (11, 16, 22)
    grazing: float = 0.1
    room: float = 0.5
