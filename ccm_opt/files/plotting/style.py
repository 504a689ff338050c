"""Colours and line widths of the pictures, in one place."""

WALL, WALL_EDGE = "#d5d2cb", "#8d887d"
BOUNDARY = "#4a4740"
START, START_EDGE = "#b9c0c8", "#7f8994"
GOAL_ARM, GOAL_ARM_EDGE = "#2a6f97", "#12415e"
TIP_PATH = "#c1440e"
GOAL_MARK = "#1b7f3b"
POSE_COLOURS = "plasma"
"""Colour map of the poses on the way, early to late."""

FONT_FAMILY, FONT_SIZE = "DejaVu Sans", 8
"""matplotlib's own font, so that pictures look the same everywhere; size in points."""
MAX_NAMED_OBSTACLES = 12
"""With more obstacles than this their names would hide the picture."""
POSES_ON_THE_WAY = 7

FREE, FREE_EDGE = "#e3eef4", "#8fb0c2"
INFLATED = "#f3e6d3"
"""Room that the arm's axis has to stay out of, beside walls."""
REGION, REGION_TINT = "#2a6f97", "#dbe7ee"
PORTAL = "#c1440e"
"""Colours of the concept pages; each pair that meets differs in lightness too."""
FOLD, FOLD_EDGE = "#f0b429", "#9a6b00"
