"""Rules between keys that no single value can break: exactly one of several, and what is not supported yet."""

from collections.abc import Mapping, Sequence

from ccm_opt.problem_file.issues import Issues, closest
from ccm_opt.problem_file.keypath import KeyPath, lookup, without

UNSUPPORTED: Mapping[KeyPath, str] = {
    ("arm", "feed"): "a feed axis is not supported yet; leave it out for a fixed base",
    ("start", "feed"): "a feed axis is not supported yet; leave it out for a fixed base",
    ("limits", "feed_velocity"): "a feed axis is not supported yet; leave it out for a fixed base",
    ("limits", "feed_acceleration"): "a feed axis is not supported yet; leave it out for a fixed base",
    ("limits", "feed_force"): "a feed axis is not supported yet; leave it out for a fixed base",
}
OBSTACLE_KINDS = ("polygon", "box", "circle", "wall")
ROOM_KINDS = ("bounds", "boundary")
START_KINDS = ("shape", "joints_deg", "segments")
GOAL_KINDS = ("position", "joints_deg", "shape", "segments")


def refuse_unsupported(data: Mapping[str, object], issues: Issues) -> Mapping[str, object]:
    """Note the parts of the format that this version cannot do, and return the data without them."""
    for path, message in UNSUPPORTED.items():
        if lookup(data, path) is not None:
            issues.add(path, message)
            data = without(data, path)
    return data


def check_alternatives(data: Mapping[str, object], issues: Issues) -> None:
    """Every table that offers alternatives must take exactly one, and a heading needs something to apply to."""
    _exactly_one(data, ("workspace",), ROOM_KINDS, issues)
    obstacles = lookup(data, ("workspace", "obstacles"))
    for k in range(len(obstacles) if isinstance(obstacles, list) else 0):
        _exactly_one(data, ("workspace", "obstacles", k), OBSTACLE_KINDS, issues)
    _own_names(obstacles, issues)
    _exactly_one(data, ("start",), START_KINDS, issues)
    _exactly_one(data, ("goal",), GOAL_KINDS, issues)
    _heading_applies(data, ("start",), ("segments",), issues)
    _heading_applies(data, ("goal",), ("position", "segments"), issues)
    _masses(data, issues)


def _given(data: Mapping[str, object], path: KeyPath, kinds: Sequence[str]) -> list[str]:
    return [kind for kind in kinds if lookup(data, (*path, kind)) is not None]


def _exactly_one(data: Mapping[str, object], path: KeyPath, kinds: Sequence[str], issues: Issues) -> None:
    if not isinstance(lookup(data, path), Mapping):
        return
    given = _given(data, path, kinds)
    if len(given) != 1 and not (not given and _misspelt(data, path, kinds)):
        got = f"got {' and '.join(given)}" if given else "got none of them"
        issues.add((*path, given[1]) if given else path, f"expected exactly one of {', '.join(kinds)}; {got}")


def _misspelt(data: Mapping[str, object], path: KeyPath, kinds: Sequence[str]) -> bool:
    """Whether a key of the table is meant to be one of ``kinds``: that is reported already."""
    table = lookup(data, path)
    return any(closest(key, kinds) is not None for key in (table if isinstance(table, Mapping) else ()))


def _own_names(obstacles: object, issues: Issues) -> None:
    """Every obstacle's name, given or by its place, must be its own: messages call it by that."""
    first: dict[object, int] = {}
    for k, entry in enumerate(obstacles if isinstance(obstacles, list) else ()):
        given = entry.get("name") if isinstance(entry, Mapping) else None
        name = str(given or f"obstacle {k + 1}")
        if first.setdefault(name, k) != k:
            path: KeyPath = ("workspace", "obstacles", k)
            issues.add(
                (*path, "name") if given else path,
                f"the name '{name}' is taken by workspace.obstacles[{first[name]}]; give each obstacle its own",
            )


def _heading_applies(data: Mapping[str, object], path: KeyPath, kinds: Sequence[str], issues: Issues) -> None:
    if lookup(data, (*path, "heading_deg")) is not None and not _given(data, path, kinds):
        issues.add((*path, "heading_deg"), f"only allowed together with {' or '.join(kinds)}")


def _masses(data: Mapping[str, object], issues: Issues) -> None:
    if len(_given(data, ("arm",), ("link_mass", "masses"))) == 2:
        issues.add(("arm", "masses"), "expected only one of link_mass, masses; got both")
