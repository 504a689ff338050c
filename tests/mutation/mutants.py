"""Small mistakes in a module: other comparisons, signs, numbers, conditions, least for most, statements left out."""

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass

OTHER_OPERATOR: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Div,
    ast.Mod: ast.Div,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.Break: ast.Continue,
    ast.Continue: ast.Break,
}
OPPOSITE = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}
"""Comparisons that are turned round, too: at the boundary alone a mistake is often none."""
OTHER_NAME = {
    "maximum": "minimum",
    "minimum": "maximum",
    "max": "min",
    "min": "max",
    "any": "all",
    "all": "any",
    "argmax": "argmin",
    "argmin": "argmax",
    "floor": "ceil",
    "ceil": "floor",
    "zeros": "ones",
    "ones": "zeros",
    "sin": "cos",
    "cos": "sin",
    "cumsum": "diff",
    "fmax": "fmin",
    "fmin": "fmax",
}


@dataclass(frozen=True)
class Mutant:
    """A mistake in a module.

    Attributes:
        number: of all that the module can have, from 0.
        first: line where what it changes begins.
        last: line where it ends.
        at_import: whether it is met when the module is loaded, and by no test alone.
        before: what stood there.
        after: what stands there now.
    """

    number: int
    first: int
    last: int
    at_import: bool
    before: str
    after: str


Mistake = tuple[ast.AST, Callable[[], None]]
"""Where something is changed, and what changes it."""


@dataclass(frozen=True)
class _Site:
    node: ast.AST
    apply: Callable[[], None]
    at_import: bool


def count_of(source: str) -> int:
    """How many mistakes a module can have."""
    return len(list(_sites(ast.parse(source))))


def mutated_tree(source: str, number: int) -> ast.Module:
    """The module with one of its mistakes."""
    tree = ast.parse(source)
    list(_sites(tree))[number].apply()
    return ast.fix_missing_locations(tree)


def described(source: str, number: int) -> Mutant:
    """One of a module's mistakes, for people."""
    tree = ast.parse(source)
    site = list(_sites(tree))[number]
    first: int = site.node.lineno  # type: ignore[attr-defined]
    last: int = site.node.end_lineno  # type: ignore[attr-defined]
    statement = next(each for each in _statements(tree) if any(part is site.node for part in ast.walk(each)))
    before = _shortened(ast.unparse(statement))
    site.apply()
    after = _shortened(ast.unparse(statement))
    return Mutant(number, first, last, site.at_import, before, "pass" if after == before else after)


def _statements(tree: ast.Module) -> Iterator[ast.stmt]:
    """All statements, the innermost first."""
    for node in tree.body:
        yield from _innermost_first(node)


def _innermost_first(node: ast.AST) -> Iterator[ast.stmt]:
    for child in ast.iter_child_nodes(node):
        yield from _innermost_first(child)
    if isinstance(node, ast.stmt):
        yield node


def _shortened(text: str) -> str:
    line = text.partition("\n")[0]
    return line if len(line) < 200 else f"{line[:200]} …"


def _sites(node: ast.AST, *, in_function: bool = False) -> Iterator[_Site]:
    """Everywhere a mistake can be made, in the order of the text; words for people, types and tuning are left alone."""
    if isinstance(node, (ast.Raise, ast.JoinedStr, ast.Import, ast.ImportFrom)):
        return
    for place, apply in _mistakes(node):
        yield _Site(place, apply, not in_function)
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list", "type_comment"}:
            continue
        # Defaults of arguments are worked out where the function is defined.
        inside = in_function or (name == "body" and isinstance(node, (ast.FunctionDef, ast.Lambda)))
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not _is_any_negative(child, node):
                yield from _sites(child, in_function=inside)


def _is_any_negative(node: ast.AST, parent: ast.AST) -> bool:
    """Whether it stands for a length that numpy is to work out, as any other negative number would."""
    reshapes = isinstance(parent, ast.Call) and isinstance(parent.func, ast.Attribute) and parent.func.attr == "reshape"
    return reshapes and isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)


def _mistakes(node: ast.AST) -> Iterator[Mistake]:
    """Mistakes in a node itself."""
    yield from _other_operators(node)
    yield from _other_values(node)
    if isinstance(node, (ast.If, ast.IfExp)):
        yield node.test, _set(node, "test", ast.Constant(value=True))
        yield node.test, _set(node, "test", ast.Constant(value=False))
    body = getattr(node, "body", None)
    for k, statement in enumerate(body if isinstance(body, list) else []):
        if _can_be_left_out(statement):
            yield statement, _put(body, k, ast.Pass())


def _other_operators(node: ast.AST) -> Iterator[Mistake]:
    match node:
        case ast.Compare():
            for k, operator in enumerate(node.ops):
                yield node, _put(node.ops, k, OTHER_OPERATOR[type(operator)]())
                if type(operator) in OPPOSITE:
                    yield node, _put(node.ops, k, OPPOSITE[type(operator)]())
        case ast.BinOp() | ast.AugAssign() | ast.BoolOp() if type(node.op) in OTHER_OPERATOR:
            yield node, _set(node, "op", OTHER_OPERATOR[type(node.op)]())
        case ast.UnaryOp(op=ast.USub() | ast.Not() | ast.Invert()):
            yield node, _set(node, "operand", ast.UnaryOp(node.op, node.operand))  # twice is not at all


def _other_values(node: ast.AST) -> Iterator[Mistake]:
    match node:
        case ast.Constant(value=bool()):
            yield node, _set(node, "value", not node.value)
        case ast.Constant(value=int() | float()):
            yield node, _set(node, "value", node.value + 1)  # type: ignore[operator]
        case ast.Name() if node.id in OTHER_NAME:
            yield node, _set(node, "id", OTHER_NAME[node.id])
        case ast.Attribute() if node.attr in OTHER_NAME:
            yield node, _set(node, "attr", OTHER_NAME[node.attr])


def _can_be_left_out(statement: ast.stmt) -> bool:
    """Whether it does something to what is there already."""
    if isinstance(statement, ast.Expr):
        return isinstance(statement.value, ast.Call)
    return isinstance(statement, (ast.AugAssign, ast.Break, ast.Continue))


def _put(items: list[ast.AST], place: int, new: ast.AST) -> Callable[[], None]:
    def apply() -> None:
        items[place] = new

    return apply


def _set(node: ast.AST, field: str, value: object) -> Callable[[], None]:
    return lambda: setattr(node, field, value)
