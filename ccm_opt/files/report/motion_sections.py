"""The sections of charts over time, whose curves the page's script draws."""

from collections.abc import Collection

from ccm_opt.files.report.markup import Markup, element

_JOINTS = (("bends", ""), ("velocities", ""), ("accelerations", ""), ("torques", "simulated-torques"))
"""Groups of curves with one for every joint, and what is drawn beside the joint that is chosen."""
_OTHERS = ("feed", "feed-velocity", "feed-force", "tip-speed")


def timing_section() -> Markup:
    """What limits the speed."""
    return element(
        "section",
        element("h2", "Timing: what limits the speed"),
        element("div", element("figure", id="phase"), element("figure", id="shares"), cls="charts"),
    )


def joints_section(groups: Collection[str], *, curvature: bool = True) -> Markup:
    """Every joint over time, the base and the tip, and the curvature along the arm.

    Args:
        groups: keys of the groups of curves that there are.
        curvature: whether there is a chart of the curvature along the arm.
    """
    choice = element("select", element("option", "all joints", value=""), id="joint", aria_label="joint")
    figures = [
        element("figure", data_group=key, data_beside=beside or None) for key, beside in _JOINTS if key in groups
    ]
    figures += [element("figure", data_group=key) for key in _OTHERS if key in groups]
    return element(
        "section",
        element("h2", "Joints, curvature, tip" if curvature else "Joints, tip"),
        element(
            "p",
            "Show ",
            choice,
            " from the base (blue) to the tip (red). Click in a chart to go to a time.",
            cls="no-print",
        ),
        element("div", element("figure", id="curvature") if curvature else None, *figures, cls="charts"),
    )


def simulation_section(groups: Collection[str]) -> Markup | None:
    """Plan against simulation; nothing where there is no simulated motion."""
    if "tracking" not in groups:
        return None
    words = "How far the simulated arm is from its plan, joint by joint. The scene can show it as a layer of its own."
    charts = (element("figure", data_group=key) for key in ("tracking", "simulated-torques"))
    return element(
        "section", element("h2", "Plan and simulation"), element("p", words), element("div", *charts, cls="charts")
    )
