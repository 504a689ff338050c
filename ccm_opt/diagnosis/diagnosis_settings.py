"""The numbers of the explanation of failures, in one place: proofs, tight places, and tries of changed problems."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class PassageProofSettings:
    """How finely passages are measured, and which obstacles are taken away.

    Attributes:
        fineness: relative accuracy of the widest inflation. Taste.
        touching: overlap that counts as touching in a proof, and room that is granted to every passage, as a share of
            the arm's length. Derived: of the size of what the verifier lets pass, above all rounding.
        arc_sides: sides of a quarter of a circle; inscribed arcs lose 0.2 % of their radius. Taste.
    """

    fineness: float = 1e-3
    touching: float = 1e-6
    arc_sides: int = 12


@dataclass(frozen=True)
class TightnessSettings:
    """What counts as tight though it is not proved too tight.

    Attributes:
        narrow: a gap narrower than this many diameters is reported. Taste.
        short: an arm shorter than this multiple of the route is reported. Taste.
        stiff: a turn with less room than this multiple of what the tightest bend needs is reported. Taste.
        least_turn: turns of a route below this are not reported [rad]. Taste: 20°.
    """

    narrow: float = 1.5
    short: float = 1.08
    stiff: float = 1.25
    least_turn: float = 0.3490658503988659


@dataclass(frozen=True)
class MovedGoalSettings:
    """How the nearest goal that can be taken is looked for.

    Attributes:
        stretch: share of its length to which the arm can be expected to stretch. Taste.
        turn_step: between headings that are looked at [rad]. Taste: 2°.
        steps: how far beyond the nearest that may be taken the goal is moved, as shares of how far that is or of the
            arm's length, whichever is less, and turned, as shares of the turn. Taste: what is free for the last link
            need not be so for those before it.
        cell: distance between places that are looked at where the nearest is hopeless, as a share of the arm's length.
            Taste.
        near: half the side of the first grid in space, as a multiple of radius and clearance. Taste.
    """

    near: float = 4.0
    stretch: float = 0.99
    turn_step: float = 0.03490658503988659
    steps: tuple[float, ...] = (0.045, 0.3, 1.0)
    cell: float = 0.02


@dataclass(frozen=True)
class UnitHintSettings:
    """Which numbers look as if they were given in another unit.

    Attributes:
        thick: the same of a radius or a clearance to the arm's length. Derived: arms are some ten to a thousand times
            as long as either.
    """

    thick: tuple[float, float] = (1.0, 1000.0)


@dataclass(frozen=True)
class FirstLinksSettings:
    """How finely the poses of the first links are looked at.

    Attributes:
        shares: for one link, two, three: how far a point may move within half a cell, as a share of the distance that
            an axis keeps from walls. Measured: of 8 goals for the whole arm among 30 polygons that nobody reaches two
            links prove 5 in 5 ms, three 2 more in 0.2 s.
        most_cells: where there are more, nothing is proved. Taste: a second, for joints that turn by 90°.
        places: along a link that are looked up. Taste: more prove hardly more.
        most_removed: obstacles that are taken away one at a time, nearest to the base first. Taste.
        bisections: of the radius that would do. Taste: 3 %.
        rounding: of bends and lengths, relative [rad]. Derived: more than all rounding together.
    """

    shares: tuple[float, ...] = (0.1, 0.1, 0.3)
    most_cells: int = 4_000_000
    places: int = 5
    most_removed: int = 4
    bisections: int = 5
    rounding: float = 1e-9


@dataclass(frozen=True)
class TrialSettings:
    """How changed problems are tried, and for how long.

    Attributes:
        longest_try: CPU time that one try may use at most [s]. Taste.
        longest_further_try: the same when something that helps is known [s]. Taste.
        longest_search: CPU time for causes and tries together, from when there is a reason on [s]. Taste: who waits
            for changes has the reason already.
        patience: CPU time after which nothing new is begun when something that helps is known [s]. Taste.
        room_spare: room beyond radius and clearance in bounds that are made wide enough, as a share of the arm's
            length. Taste.
    """

    longest_try: float = 2.5
    longest_further_try: float = 0.6
    longest_search: float = 15.0
    patience: float = 2.0
    room_spare: float = 0.02


@dataclass(frozen=True)
class ReachSettings:
    """How closely directions are looked at along which an arm may fall short of its goal.

    Attributes:
        directions: over the whole sphere, at first. Taste: 6° between them.
        refinements: how often that is done, each time half as far apart. Taste: to a tenth of a degree.
    """

    directions: int = 1000
    refinements: int = 8


@dataclass(frozen=True)
class WaySettings:
    """How finely the room about an arm in space is looked at for ways of its axis.

    Attributes:
        finest: cubes are not split below this share of the room that is asked about. Taste: that is then known to a
            twentieth.
        more_cells: that are added for how wide the widest way is, at each width, likewise. Taste.
        narrow: a way narrower than this multiple of what the arm needs is told. Taste.
        seconds: CPU time after which nothing more is looked at about one goal [s]. Taste: half of all the time for
            reasons and changes.
    """

    finest: float = 0.04
    more_cells: int = 40_000
    narrow: float = 1.5
    seconds: float = 8.0


def _space_trials() -> TrialSettings:
    """In space a motion takes some times as long to find as in the plane."""
    return TrialSettings(longest_try=4.0, longest_further_try=2.0, patience=6.0)


@dataclass(frozen=True)
class DiagnosisSettings:
    """All numbers of the explanation of failures.

    Attributes:
        passages: of the proofs that no way is wide or short enough.
        tightness: of what is likely to stand in the way.
        units: of numbers that look as if they were given in another unit.
        moved_goal: of the nearest goal that can be taken.
        first_links: of the proof that the first links cannot turn to the goal.
        reach: of the proof that an arm cannot turn to its goal.
        ways: of the search for ways of an arm in space.
        trials: of the tries of changed problems.
        space_trials: the same in space, with more time.
        figures: figures that a reported value keeps, rounded to the easier side before it is solved. Taste.
    """

    passages: PassageProofSettings = field(default_factory=PassageProofSettings)
    tightness: TightnessSettings = field(default_factory=TightnessSettings)
    units: UnitHintSettings = field(default_factory=UnitHintSettings)
    moved_goal: MovedGoalSettings = field(default_factory=MovedGoalSettings)
    first_links: FirstLinksSettings = field(default_factory=FirstLinksSettings)
    reach: ReachSettings = field(default_factory=ReachSettings)
    ways: WaySettings = field(default_factory=WaySettings)
    trials: TrialSettings = field(default_factory=TrialSettings)
    space_trials: TrialSettings = field(default_factory=_space_trials)
    figures: int = 4


DEFAULT_DIAGNOSIS = DiagnosisSettings()
"""The numbers that are used unless others are passed."""
