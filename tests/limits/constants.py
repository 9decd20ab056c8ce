"""The numeric constants of modules: names in capitals to which a module assigns a number, or a tuple of numbers."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

CAPITALS = re.compile(r"_*[A-Z][A-Z0-9_]*")
CONVERSIONS = {"complex", "exp", "float", "int", "len", "log", "max", "min", "radians", "round", "sqrt"}
ATTRIBUTES = {"e", "eps", "inf", "max", "maxsize", "min", "nan", "pi", "tiny"}


@dataclass(frozen=True)
class Constant:
    """A name in capitals that stands for a number.

    Attributes
    ----------
    module : str
        Path of its module below the package, such as "readers/message_reader.py".
    name : str
    line : int
    value : ast.expr
        What is assigned to it; of several names that share a value, as `range(4)`, what all of them share.
    """

    module: str
    name: str
    line: int
    value: ast.expr

    @property
    def label(self) -> str:
        return f"{self.module}:{self.name}"


def is_number(node: ast.expr, numbers: set[str]) -> bool:
    """Tell whether an expression is a number, or a tuple or list of numbers; `numbers` are names that are."""
    match node:
        case ast.Constant(value=value):
            return isinstance(value, int | float | complex) and not isinstance(value, bool)
        case ast.Name(id=name):
            return name in numbers
        case ast.Attribute(attr=attribute):
            return attribute in ATTRIBUTES or attribute in numbers
        case ast.UnaryOp(operand=operand):
            return is_number(operand, numbers)
        case ast.BinOp(left=left, right=right):
            # A power of two times a name from elsewhere is a number, "text" * 3 is none.
            return any(is_number(side, numbers) for side in (left, right)) and not any(
                isinstance(side, ast.Constant) and isinstance(side.value, str | bytes) for side in (left, right)
            )
        case ast.Tuple(elts=elements) | ast.List(elts=elements):
            return bool(elements) and all(is_number(e, numbers) for e in elements)
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=arguments):
            return name == "range" or (name in CONVERSIONS and any(is_number(a, numbers) for a in arguments))
    return False


def _assigned(statement: ast.stmt) -> Iterator[tuple[ast.Name, ast.expr]]:
    """Yield the names that a statement assigns to, each with its value."""
    match statement:
        case ast.Assign(targets=targets, value=value):
            pairs = [(target, value) for target in targets]
        case ast.AnnAssign(target=target, value=ast.expr() as value):
            pairs = [(target, value)]
        case _:
            return
    for target, whole in pairs:
        if isinstance(target, ast.Name):
            if not (isinstance(whole, ast.Call) and isinstance(whole.func, ast.Name) and whole.func.id == "range"):
                yield target, whole
        elif isinstance(target, ast.Tuple | ast.List):
            each = whole.elts if isinstance(whole, ast.Tuple | ast.List) else []
            for i, element in enumerate(target.elts):
                if isinstance(element, ast.Name):
                    yield element, each[i] if len(each) == len(target.elts) else whole


def constants_of(source: str, module: str) -> list[Constant]:
    """Return the numeric constants of a module, in their order."""
    found: list[Constant] = []
    for statement in ast.parse(source).body:
        known = {c.name for c in found}
        found += [
            Constant(module, name.id, name.lineno, value)
            for name, value in _assigned(statement)
            if CAPITALS.fullmatch(name.id) and is_number(value, known)
        ]
    return found


def constants_below(package: Path) -> list[Constant]:
    """Return the numeric constants of all modules below a folder, by module."""
    return [
        constant
        for path in sorted(package.rglob("*.py"))
        for constant in constants_of(path.read_text(encoding="utf-8"), path.relative_to(package).as_posix())
    ]
