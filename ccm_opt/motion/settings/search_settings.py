"""Settings of the search over all strategies, and of the smooth path that is laid through what it finds."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """Numbers of the search.

    Attributes:
        margins: planning margins that are tried in turn, in nominal links: the wide one finds smoother motions, the
            narrow one gets through. Measured: with less than the narrow one, the first candidate failed in one scene.
        tree_margins: margins that trees of poses are grown with, in nominal links: a wide one moves on faster, a
            narrow one gets through. Taste.
        reach: contacts nearer than this make rows of the step, in nominal links. Taste: a step moves a link by less.
        reach_margins: the same in planning margins, where that is more. Taste.
        design_links: arms with more links are planned with this many, or as many as narrow passages ask for, and
            lifted. Measured: of 38 motions found in clutter with this many, 34 held on finer arms as they were.
        many_links: times that number of links from which lifting pays. Taste.
        lift_margin: gap that an optimised motion keeps when it is to be lifted, as a share of the arm's length.
            Taste: about what an arm of 24 links leaves the curve by.
        many_walls: walls in the neighbourhood beyond which the tip is led along every path before poses at the goal are
            looked for. Taste: among a thousand, such poses take seconds.
        put_off: probability with which a seed other than 0 puts a candidate off until the others have been tried.
            Taste.
        spare: gap beyond contact that the certificate asks for, as a share of the arm's length. Taste.
        spare_at_ends: share of the gap at the ends that the certificate may ask for. Taste.
        spare_in_gates: the same of the gap in narrow gates. Taste: half of what poses keep there by their margin.
        end_reach: gaps at the ends that are looked at, in spares. Taste.
    """

    margins: tuple[float, ...] = (0.06, 0.024)
    tree_margins: tuple[float, ...] = (0.12, 0.06, 0.024)
    reach: float = 0.96
    reach_margins: float = 4.0
    design_links: int = 24
    many_links: float = 1.5
    lift_margin: float = 3e-3
    many_walls: int = 150
    put_off: float = 0.5
    spare: float = 1e-4
    spare_at_ends: float = 0.5
    spare_in_gates: float = 0.1
    end_reach: float = 4.0


@dataclass(frozen=True)
class SmoothPathSettings:
    """Numbers of the C² path through joint space.

    Attributes:
        least_samples: least samples of a span between which the certificate takes the headings to be linear. Taste.
        most_samples: most samples of a span. Taste.
        spare_share: share of the certificate's spare gap that linear interpolation between samples may err by; a path
            keeps the rest. Taste.
        least_error: share of the arm's length that it may err by, whatever the certificate spares. Derived: a few
            times the depth that still counts as contact.
        refinements: rounds of halving legs where a span fails. Taste.
        equation_samples: samples of a span at which limits are looked at that the path is laid through. Taste.
        first_spans: spans of the first such path. Taste.
        most_spans: spans at which it is given up. Taste.
        rounds: rounds of halving its spans. Taste.
        newton_steps: most steps of Newton's method that bring a knot onto the limits. Taste.
        met: by how much a knot may miss them, in their units. Derived: four orders below what the verifier allows.
        rank: singular values below this share of the largest count as none. Taste.
        joint_share: share of a joint limit to which bends beyond that are brought back. Taste.
        certified_samples: samples of a span between which the certificate takes the headings to be linear. Taste.
        most_certified: samples of the whole path at most. Taste: the certificate's cost.
    """

    least_samples: int = 4
    most_samples: int = 96
    spare_share: float = 0.5
    least_error: float = 2e-6
    refinements: int = 5
    equation_samples: int = 8
    first_spans: int = 48
    most_spans: int = 1200
    rounds: int = 10
    newton_steps: int = 12
    met: float = 1e-10
    rank: float = 1e-9
    joint_share: float = 0.995
    certified_samples: int = 12
    most_certified: int = 6000
