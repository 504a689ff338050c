"""Settings of the trees of poses, the fall-back of the search."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class ExtensionSettings:
    """Numbers by which extensions are drawn at random.

    Attributes:
        to_shape: how often, against the other kinds, the whole arm is led to a random shape. Taste, as all of these:
            scenes differ in what helps, so every kind has its turn.
        to_bump: how often a part of the arm is bent aside.
        to_place: how often the tip is led to a random place.
        along_route: how often the tip is led back along the arm and out along a route.
        folded: how often the arm is pulled over to a route as a rope.
        to_other: how often the whole arm is led to a pose of the other tree.
        shape_knots: curvature of a random shape is linear between so many knots. Taste.
        shape_curvature: standard deviation of that curvature, times the arm's length. Taste.
        bump_turn: standard deviation of a local change of heading [rad]. Taste.
        bump_widths: least and greatest width of such a change, as shares of the arm's length. Taste.
        shapes_as_routes: share of routes that are shapes of the other tree. Taste.
        node_choice: of so many random nodes the least used is extended. Taste.
        tip_choice: a place for the tip is given to the nearest of so many nodes, drawn at random. Taste.
        places_drawn: places drawn at once when a free one is looked for. Taste.
    """

    to_shape: float = 0.25
    to_bump: float = 0.15
    to_place: float = 0.15
    along_route: float = 0.1
    folded: float = 0.15
    to_other: float = 0.2
    shape_knots: int = 6
    shape_curvature: float = 3.0
    bump_turn: float = 0.8
    bump_widths: tuple[float, float] = (0.05, 0.3)
    shapes_as_routes: float = 0.3
    node_choice: int = 4
    tip_choice: int = 6
    places_drawn: int = 64


@dataclass(frozen=True)
class TreeSettings:
    """Numbers of the trees of poses.

    Attributes:
        steps: of the longest extension. Taste.
        patience: steps without progress before an extension ends. Taste.
        connection_patience: the same for a connection of the trees; what it does not reach, an extension may. Taste.
        dispersion: distance that nodes keep, as ``heading_weight`` measures it. Taste.
        heading_weight: of a radian of heading against the length of the arm in the distance of two poses. Taste.
        node_interval: least number of steps between two nodes of one extension. Taste.
        saturated: extensions in a row that add no node before the search is given up. Taste.
        most_extensions: extensions in all before the search is given up, however much time is left, so that what is
            found does not depend on it. Measured in 24 scenes of clutter: 22 need at most 16, one 51, one 201.
        connections: nodes of the other tree that a new node is connected to, nearest first. Taste.
        root_interval: extensions between two new poses at the goal. Taste.
        settling_distance: a tip nearer to its goal than this is drawn onto it, in nominal links. Derived: twice the
            leash of tip-led continuation.
        extensions: by which extensions are drawn.
    """

    steps: int = 250
    patience: int = 12
    connection_patience: int = 5
    dispersion: float = 0.04
    heading_weight: float = 0.1
    node_interval: int = 10
    saturated: int = 80
    most_extensions: int = 400
    connections: int = 1
    root_interval: int = 40
    settling_distance: float = 3.0
    extensions: ExtensionSettings = field(default_factory=ExtensionSettings)


DEFAULT_TREES = TreeSettings()
"""What trees take when they are not given other settings."""
