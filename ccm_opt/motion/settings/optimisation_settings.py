"""Settings of the optimisation of a certified motion."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ObjectiveSettings:
    """Weights inside the objective; what the user weighs stands in the problem.

    Attributes:
        heading: weight of the turns of the links beside the turns of the joints. Taste.
        unevenness: weight of ``∫|q''|²``; its root is the share of the motion over which corners are rounded. Taste.
        shape: weight of the curve's curvature and of its differences, in nominal links. Taste.
        shape_change: share of that weight on changes of the curvature from keyframe to keyframe. Taste.
        second_heading: weight of the turns of the links in ``∫|q''|²``. Taste.
        ridge: weight on changes of all coordinates, so that the metric is definite. Taste.
        blend: weight on changes of the coordinate that blends a whole-arm goal in. Taste.
        wall_distance: walls farther than this beyond the planning margin cost nothing where clearance is weighed, as
            a share of the arm's length. Taste.
    """

    heading: float = 1e-3
    unevenness: float = 4e-3
    shape: float = 1e-3
    shape_change: float = 0.1
    second_heading: float = 0.1
    ridge: float = 1e-8
    blend: float = 1e-3
    wall_distance: float = 0.03


@dataclass(frozen=True)
class BottleneckSettings:
    """How much more the busiest joints count, once a motion is nearly optimal.

    Attributes:
        share: of the weight of the path's length that goes to the joints by how busy they are. Measured: with 0.9 and a
            power of a half, 13 motions last 2.6 % less in the median, at best 15 % less and at worst 0.5 % longer.
        power: of a joint's largest turn from keyframe to keyframe over the root mean square of all joints'. Measured:
            with 1 the same motions last 1 % longer in the median.
        least: that ratio counts as at least this much. Taste.
        least_keyframes: a motion of fewer keyframes has no second differences to speak of. Derived.
    """

    share: float = 0.9
    power: float = 0.5
    least: float = 0.2
    least_keyframes: int = 4


@dataclass(frozen=True)
class InteriorPointSettings:
    """Numbers of the reference, one nonlinear program.

    Attributes:
        solutions: of the nonlinear program, the sweep regions renewed between them. Taste.
        wider: rows this many times farther away than those of a sequential step are taken in. Taste.
        iterations: of IPOPT. Taste.
        tolerance: of IPOPT. Taste.
        shortenings: shares of the way to the solution that are tried until one is certified. Taste.
    """

    solutions: int = 2
    wider: float = 2.0
    iterations: int = 200
    tolerance: float = 1e-5
    shortenings: tuple[float, ...] = (1.0, 0.5, 0.25, 0.1)


@dataclass(frozen=True)
class OptimisationSettings:
    """Numbers of the optimisation of a motion.

    Attributes:
        intervals: least number of intervals; a motion that needs more legs to be certified keeps them. Measured:
            twice as many shortened motions by 5 % at most.
        moved_intervals: numbers of intervals that are tried where keyframes have to be moved onto limits, until the
            motion through them is certified. Taste.
        gate_intervals: the same in gates with hardly any play. Taste: the play of a hundredth of a radius asks for
            about sixty.
        gate_halvings: times that legs which fail there may be halved. Taste.
        leg_depth: bisections that a leg of the thinned motion may need for its certificate. Taste.
        first_stride: keyframes that a leg of the thinned motion skips at first. Taste.
        margin: gap that rows ask for beyond contact, as a share of the arm's length. Taste.
        reach: walls and links farther apart than this many links make no rows. Taste.
        largest_link: share of the arm's length that counts as a link at most. Taste.
        active: rows nearer to their bound than this many such links enter the QP. Taste.
        active_at_many: share of that at many keyframes. Measured: among 300 and 1000 polygons the same motions in three
            quarters of the time.
        sectors: directions that count as different when rows are thinned. Taste.
        groups: arms with more links than this have rows for groups of neighbouring joints. Taste.
        worth_many: share of the way by which steps at many keyframes have to shorten it for more of them. Taste.
        most_intervals: intervals of a motion beyond which none that lets nothing move is cut finer. Taste.
        rounds: most steps that are taken. Taste.
        first_rounds: steps at many keyframes, before the motion is thinned again. Taste.
        counted_rounds: as how many of the rounds these count. Measured: with 5, six crooked motions among clutter
            lasted 2 % longer in the median.
        many: keyframes that are many, as a multiple of the intervals wanted. Taste.
        kept_share: share of its gap that a motion keeps when it is thinned. Taste.
        lack: share of the wanted gap that an interval may lack without its slack becoming dearer. Taste.
        lack_rise: rise of the price of slack where an interval lacks room, step by step. Taste.
        highest_lack_price: to which it rises. Taste.
        free_rounds: most steps before it is decided where the motion ends. Taste.
        end_rounds: most steps after that. Taste.
        bending_from: places along the motion, as shares of it, from where on it is tried to be bent to another end.
            Taste.
        enough_room: share of the wanted gap, or of what the ends leave of it, that is enough. Taste.
        finer: as many times the keyframes where a motion lacks room. Measured: of 18 motions among clutter that lacked
            it, few gained much with as many as before, some with half as many more, most with this.
        finest: intervals beyond which a motion is not cut finer for its room. Taste: the cost of a step.
        room_passes: times that steps at these keyframes are begun anew, with fresh prices. Taste.
        room_rounds: most steps of each. Taste.
        room_worth: as many times the room have to be gained for one more. Taste.
        room_growth: as many times the most room so far count as growth. Taste.
        room_patience: steps without growth after which a pass ends. Taste.
        roomier: as many times the room of another motion decide between two before their lengths do. Taste.
        room_samples: places beside each leg between keyframes at which the room of a smooth path is measured. Taste.
        moved_rounds: the same where keyframes have to be moved onto limits. Taste.
        tries: QPs of one round before it is given up. Taste.
        worth: share of the objective that a round has to gain. Taste.
        worth_afresh: share of the objective that has to be gained for prices and damping that let nothing move to be
            put back to where they began. Taste.
        patience: rounds in a row that may gain less. Taste.
        price: first price of one nominal link of slack. Taste.
        price_rise: its rise where the certificate fails. Taste.
        first_damping: weight on the squared turns of the first step. Taste.
        raised_damping: damping from which a refused step raises it. Taste.
        refused_growth: growth of the damping after a refused step. Taste.
        halved_growth: its growth after a step of half its length or more. Taste.
        shortened_growth: its growth after a shorter step. Taste.
        good_shrinkage: its fall after a good step. Taste.
        least_damping: least damping. Taste.
        shortenings: shares of a step that are tried until one is certified. Taste.
        yieldings: times that keyframes about intervals which are not certified take less of a step in gates. Taste.
        yielding: share of its part of the step that such a keyframe keeps each time. Taste.
        yielding_reach: keyframes on either side that give way with it, less and less. Taste.
        sufficient: share of the foreseen gain at which a step is taken. Taste.
        good: share of the foreseen gain from which a step is good. Taste.
        damping_ridge: damping of coordinates beside that of the turns. Taste.
        slack_curvature: curvature of slack, so that the Hessian is definite. Taste.
        qp_tolerance: of the QP's solution. Taste.
        qp_gap: duality gap of the QP's solution; a tenth of it relative. Taste.
        qp_iterations: of the QP. Taste.
    """

    intervals: int = 20
    moved_intervals: tuple[int, ...] = (24, 48, 96)
    gate_intervals: tuple[int, ...] = (40, 60, 90, 135)
    gate_halvings: int = 3
    leg_depth: int = 2
    first_stride: int = 16
    margin: float = 1e-3
    reach: float = 2.5
    largest_link: float = 1.0 / 36.0
    active: float = 1.1
    active_at_many: float = 0.5
    sectors: int = 12
    groups: int = 36
    worth_many: float = 0.05
    most_intervals: int = 60
    rounds: int = 14
    free_rounds: int = 9
    first_rounds: int = 5
    counted_rounds: int = 2
    many: float = 1.5
    kept_share: float = 0.8
    lack: float = 0.03
    lack_rise: float = 2.0
    highest_lack_price: float = 500.0
    end_rounds: int = 5
    bending_from: tuple[float, ...] = (0.0, 0.5, 0.8)
    enough_room: float = 0.95
    finer: float = 2.2
    finest: int = 80
    room_passes: int = 2
    room_rounds: int = 20
    room_worth: float = 1.1
    room_growth: float = 1.02
    room_patience: int = 6
    roomier: float = 1.1
    room_samples: int = 5
    moved_rounds: int = 24
    tries: int = 5
    worth: float = 3e-3
    worth_afresh: float = 0.1
    patience: int = 2
    price: float = 30.0
    price_rise: float = 4.0
    first_damping: float = 0.3
    raised_damping: float = 0.05
    refused_growth: float = 6.0
    halved_growth: float = 2.0
    shortened_growth: float = 3.0
    good_shrinkage: float = 3.0
    least_damping: float = 1e-4
    shortenings: tuple[float, ...] = (1.0, 0.5, 0.25)
    yieldings: int = 6
    yielding: float = 0.4
    yielding_reach: float = 4.0
    sufficient: float = 0.1
    good: float = 0.6
    damping_ridge: float = 1e-3
    slack_curvature: float = 1e-6
    qp_tolerance: float = 1e-5
    qp_gap: float = 1e-3
    qp_iterations: int = 60
