"""The numbers of the explanation of failures, in one place: proofs, tight places, and tries of changed problems."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class PassageProofSettings:
    """How finely passages are measured, and which obstacles are taken away.

    Attributes:
        fineness: relative accuracy of the widest inflation. Taste.
        beyond: inflation at which the narrowest place of the widest way is closed, as a multiple of the inflation that
            just passes. Taste; ten times the fineness.
        most_removed: obstacles that are taken away one at a time, nearest to the narrow place first. Taste.
        detour: a way longer than the straight line by less than this share of it is reported by the check of reach
            alone. Taste.
        touching: overlap that counts as touching in a proof, and room that is granted to every passage, as a share of
            the arm's length. Derived: of the size of what the verifier lets pass, above all rounding.
        most_corners: corners of free space between which the shortest way is proved; where there are more it is not.
            Taste.
        arc_sides: sides of a quarter of a circle; inscribed arcs lose 0.2 % of their radius. Taste.
    """

    fineness: float = 1e-3
    beyond: float = 1.01
    most_removed: int = 16
    detour: float = 1e-3
    touching: float = 1e-6
    most_corners: int = 2000
    arc_sides: int = 12


@dataclass(frozen=True)
class TightnessSettings:
    """What counts as tight though it is not proved too tight.

    Attributes:
        narrow: a gap narrower than this many diameters is reported. Taste.
        short: an arm shorter than this multiple of the route is reported. Taste.
        stiff: a turn with less room than this multiple of what the tightest bend needs is reported. Taste.
        least_turn: turns of a route below this are not reported [rad]. Taste: 20°.
        routes: routes whose tightness is reported. Taste.
    """

    narrow: float = 1.5
    short: float = 1.08
    stiff: float = 1.25
    least_turn: float = 0.3490658503988659
    routes: int = 3


@dataclass(frozen=True)
class MovedGoalSettings:
    """How the nearest goal that can be taken is looked for.

    Attributes:
        link_samples: places along the last link that have to be free. Taste.
        stretch: share of its length to which the arm can be expected to stretch. Taste.
        turn_step: between headings that are looked at [rad]. Taste: 2°.
        steps: how far beyond the nearest that may be taken the goal is moved, as shares of how far that is or of the
            arm's length, whichever is less, and turned, as shares of the turn. Taste: what is free for the last link
            need not be so for those before it.
        cell: distance between places that are looked at where the nearest is hopeless, as a share of the arm's length.
            Taste.
        most_places: of them at most, spread over all. Taste: some 10 ms each.
    """

    link_samples: int = 5
    stretch: float = 0.99
    turn_step: float = 0.03490658503988659
    steps: tuple[float, ...] = (0.045, 0.3, 1.0)
    cell: float = 0.02
    most_places: int = 60


@dataclass(frozen=True)
class UnitHintSettings:
    """Which numbers look as if they were given in another unit.

    Attributes:
        thousand: ratios of lengths, least and greatest, that look like metres beside millimetres. Taste: such lengths
            are mostly from a tenth to ten times as long as the other would be.
        thick: the same of a radius or a clearance to the arm's length. Derived: arms are some ten to a thousand times
            as long as either.
        small_room: a room smaller than this share of the arm's length looks wrong. Taste.
        hardly_bends: sum of all bends below which a limit of a few degrees looks like radians [rad]. Taste: a right
            angle.
    """

    thousand: tuple[float, float] = (100.0, 10000.0)
    thick: tuple[float, float] = (1.0, 1000.0)
    small_room: float = 0.01
    hardly_bends: float = 1.5707963267948966


@dataclass(frozen=True)
class FirstLinksSettings:
    """How finely the poses of the first links are looked at.

    Attributes:
        shares: for one link, two, three: how far a point may move within half a cell, as a share of the distance that
            an axis keeps from walls. Measured: of 8 goals for the whole arm among 30 polygons that nobody reaches two
            links prove 5 in 5 ms, three 2 more in 0.2 s.
        most_cells: where there are more, nothing is proved. Taste: a second, for joints that turn by 90°.
        places: along a link that are looked up. Taste: more prove hardly more.
        raster_cells: of the raster of blocked places, along a side, for every link. Taste: a hundredth of a link.
        most_removed: obstacles that are taken away one at a time, nearest to the base first. Taste.
        bisections: of the radius that would do. Taste: 3 %.
        rounding: of bends and lengths, relative [rad]. Derived: more than all rounding together.
    """

    shares: tuple[float, ...] = (0.1, 0.1, 0.3)
    most_cells: int = 4_000_000
    places: int = 5
    raster_cells: int = 200
    most_removed: int = 4
    bisections: int = 5
    rounding: float = 1e-9


@dataclass(frozen=True)
class TrialSettings:
    """How changed problems are tried, and for how long.

    Attributes:
        steps: how far beyond its bound a parameter is tried, as a share of the bound, until a try succeeds. Taste.
        guessed_steps: the same where the bound is only where the problem stands. Taste.
        advised_steps: how far beyond its bound a change is looked at by the necessary checks alone, where every try
            failed, as a share of the bound. Taste.
        close: share of its value within which a parameter is bracketed by what failed, or cannot be, and what worked.
            Derived: just more than the first step is of the value after it, so that a try that succeeds there need not
            be repeated.
        least_time: no try begins with less time than this [s]. Taste.
        try_share: share of the time left that one try may use. Taste.
        longest_try: CPU time that one try may use at most [s]. Taste.
        longest_further_try: the same when something that helps is known [s]. Taste.
        longest_search: CPU time that all tries may use together, however much is left [s]. Taste.
        patience: CPU time after which nothing new is begun when something that helps is known [s]. Taste.
        enough: relaxations that are reported. Taste.
        most_dropped: constraints and costs of the user's that are dropped in a try of their own. Taste.
        room_spare: room beyond radius and clearance in bounds that are made wide enough, as a share of the arm's
            length. Taste.
        most_omitted: obstacles that are left out in a try of their own. Taste.
    """

    steps: tuple[float, ...] = (0.045, 0.1, 0.2, 0.4)
    guessed_steps: tuple[float, ...] = (0.1, 0.25, 0.5)
    advised_steps: tuple[float, ...] = (0.0, 0.25, 0.6, 1.0)
    close: float = 0.048
    least_time: float = 0.05
    try_share: float = 0.5
    longest_try: float = 2.5
    longest_further_try: float = 0.6
    longest_search: float = 8.0
    patience: float = 2.0
    enough: int = 4
    most_dropped: int = 3
    room_spare: float = 0.02
    most_omitted: int = 2


@dataclass(frozen=True)
class DiagnosisSettings:
    """All numbers of the explanation of failures.

    Attributes:
        passages: of the proofs that no way is wide or short enough.
        tightness: of what is likely to stand in the way.
        units: of numbers that look as if they were given in another unit.
        moved_goal: of the nearest goal that can be taken.
        first_links: of the proof that the first links cannot turn to the goal.
        trials: of the tries of changed problems.
        findings: findings that are reported, at most. Taste.
        figures: figures that a reported value keeps, rounded to the easier side before it is solved. Taste.
    """

    passages: PassageProofSettings = field(default_factory=PassageProofSettings)
    tightness: TightnessSettings = field(default_factory=TightnessSettings)
    units: UnitHintSettings = field(default_factory=UnitHintSettings)
    moved_goal: MovedGoalSettings = field(default_factory=MovedGoalSettings)
    first_links: FirstLinksSettings = field(default_factory=FirstLinksSettings)
    trials: TrialSettings = field(default_factory=TrialSettings)
    findings: int = 5
    figures: int = 4


DEFAULT_DIAGNOSIS = DiagnosisSettings()
"""The numbers that are used unless others are passed."""
