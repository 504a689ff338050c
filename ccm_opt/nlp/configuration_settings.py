"""The numbers of the configuration NLP, from the first guess to the dense check, in one place."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ConfigurationSettings:
    """How a configuration is guessed, what the NLP weighs and keeps, and what its check allows.

    Lengths marked [L] are in units of the arm's length, as all of the NLP.

    Attributes:
        end_tolerance: a base or goal this near its region counts as inside [arm lengths]. Taste.
        segment_totals: segments in all at the attempts after the first. Taste.
        windings: whole turns at the ends that are tried, the fewest first. Taste.
        guess_samples: samples of the guessed heading. Taste.
        path_samples: samples of the taut path at which its region is looked up. Taste.
        corner_rounding: width over which corners of the guessed heading are rounded [L]. Taste.
        end_blend: length over which the guess turns from the base's heading to the path's, and from the path's to the
            tip's [L]. Taste.
        least_region_share: length that the guess gives to each region at least [L]. Taste.
        guess_curvature: share of the curvature limit that the guess may use: it starts inside. Taste.
        knot_weight: weight of uneven knots. Taste; leaves no direction of the variables without curvature.
        bound_weight: weight of the bounds on ``|κ|``. Taste; as for the knots, and it keeps the certificates tight.
        slope_weight: weight of steps of curvature. Taste.
        nearness_weight: weight of nearness to walls, before the user's. Taste.
        nearness_distance: sides of regions farther away than this cost nothing [L]. Taste.
        least_piece: least arc length between knots [L]. Taste.
        least_spacing: least share of its segment that a piece keeps while knots are free. Taste.
        region_shrinkage: by how much regions shrink, so that quadrature and polish stay inside the real ones [L].
            Derived: ten times what the check of containment allows on an arm of a metre.
        curvature_reserve: share of the curvature limit that is kept for the polish. Taste.
        half_plane_counts: numbers of half-planes that solvers are built for, so that tasks share them. Taste.
        most_iterations: IPOPT's iterations, at most. Taste.
        optimality: residual of the optimality conditions, in the NLP's units, at which IPOPT stops. Taste: coarse,
            since the polish follows.
        violation: violation of a row, in the NLP's units, at which IPOPT may stop. Derived: a tenth of ``feasibility``.
        first_barrier: IPOPT's first barrier parameter. Taste.
        feasibility: violation of a row, in the NLP's units, that counts as satisfied. Taste; the polish mends more.
        rows_kept: violated rows that a result names. Taste.
        rows_reported: violated rows that a message names. Taste.
        polish_steps: Newton steps that bring the tip onto the goal, at most. Taste; three are usual.
        tip_tolerance: distance of the tip from the goal that the check allows [arm lengths]. Taste.
        tip_heading_tolerance: turn of the tip from the goal's heading that the check allows [rad]. Taste.
        containment_tolerance: distance outside its region at which a point of the curve passes the check [arm lengths].
            Taste.
        check_samples: points of each segment that the check looks at. Taste.
    """

    end_tolerance: float = 1e-6
    segment_totals: tuple[int, ...] = (4, 6, 8)
    windings: int = 3
    guess_samples: int = 401
    path_samples: int = 401
    corner_rounding: float = 0.06
    end_blend: float = 0.12
    least_region_share: float = 0.05
    guess_curvature: float = 0.9
    knot_weight: float = 4.0
    bound_weight: float = 0.1
    slope_weight: float = 1e-3
    nearness_weight: float = 10.0
    nearness_distance: float = 0.03
    least_piece: float = 4e-3
    least_spacing: float = 0.08
    region_shrinkage: float = 1e-5
    curvature_reserve: float = 1e-3
    half_plane_counts: tuple[int, ...] = (4, 6, 8, 12, 16, 24, 32, 48, 64)
    most_iterations: int = 80
    optimality: float = 1e-4
    violation: float = 1e-7
    first_barrier: float = 0.1
    feasibility: float = 1e-6
    rows_kept: int = 40
    rows_reported: int = 3
    polish_steps: int = 8
    tip_tolerance: float = 1e-5
    tip_heading_tolerance: float = 1e-6
    containment_tolerance: float = 1e-6
    check_samples: int = 201


DEFAULT_CONFIGURATION = ConfigurationSettings()
"""The numbers that are used unless a task brings others."""
