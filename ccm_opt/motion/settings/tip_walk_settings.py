"""Settings of walks of the tip among many walls."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TipWalkSettings:
    """Numbers of walks of the tip.

    The measured ones were chosen on nine walked fields of 1000 and 3000 polygons in which no straight attempt arrives,
    seeds 100 to 107 of ``tests/benchmarks/bench_growth.py``.

    Attributes:
        margins: planning margins with which the tip is led straight on, and that walks draw from, in nominal links.
            Measured: of fourteen fields of 1000 and 3000 polygons the first alone solves seven, the others two more.
        run_in: straight run onto the goal along its heading, in nominal links; the longest that is free. Taste.
        run_in_samples: places of the run that have to be free. Taste.
        longest_way: beyond which there are no early walks, as a share of the arm's length. Measured: in fields of 1000
            polygons with goals drawn at random, walks along 0.2 to 0.6 of the arm's length mostly arrive, and along
            1.2 to 2.0, where the arm has to be laid anew from its base, never.
        early_walks: before poses at the goal are looked for. Taste: half of what those take in vain, or less.
        late_walks: before the trees. Taste: a few times as many.
        from_start: how often a walk begins at the start, and not where another has come to. Measured: with a tenth
            fewer fields are solved, and with none but these, too.
        onto_goal: how often a walk is led on to the goal, and not only to a place drawn at random. Taste.
        by_place: how often it is led there by way of such a place, which decides how it passes the walls. Taste.
        about_goal: how often such places are drawn about the goal, and not about the tip. Taste.
        nearest: distance of such places from there at least, as a share of the arm's length. Taste.
        farthest: at most, likewise. Taste.
        places_drawn: places drawn at once when a free one is looked for. Taste.
        nearness: how much rather walks begin at poses whose tip is near the goal: distance from it at which they begin
            1/e as often as at the goal, as a share of the arm's length. Taste.
        rounding: distances that their paths keep from corners, as multiples of the usual one. Measured: with several
            the mean time to a solution was 3.3 s instead of 4.1.
    """

    margins: tuple[float, ...] = (0.012, 0.06, 0.024, 0.008)
    run_in: tuple[float, ...] = (2.0, 1.0, 0.5, 0.0)
    run_in_samples: int = 9
    longest_way: float = 0.8
    early_walks: int = 150
    late_walks: int = 120
    from_start: float = 0.35
    onto_goal: float = 0.7
    by_place: float = 0.85
    about_goal: float = 0.7
    nearest: float = 0.05
    farthest: float = 0.3
    places_drawn: int = 16
    nearness: float = 0.17
    rounding: tuple[float, ...] = (0.5, 1.0, 2.0)
