"""Walk of a parameter through the methods of a class: files that their calls with it enter, in the
order of the sources; read from these alone, by imported names, annotations and `__init__`."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field


@dataclass(slots=True)
class Walk:
    """Stays of a parameter, of which those in `home` are walked through. A call is followed where
    its function, or the class of what it is called on, is known."""

    sources: dict[str, str]
    """Text by file"""
    home: str
    stays: list[str] = field(default_factory=list)
    _defined: dict[str, tuple[str, ast.stmt]] = field(init=False)
    _seen: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        tops = [
            (file, node) for file, text in self.sources.items() for node in ast.parse(text).body
        ]
        named = ast.ClassDef | ast.FunctionDef
        self._defined = {node.name: (file, node) for file, node in tops if isinstance(node, named)}

    @property
    def returns(self) -> int:
        """Stays in a file that was left before."""
        return len(self.stays) - len(set(self.stays))

    def enter(self, of: str, method: str, me: set[str]) -> None:
        """Enter a method of a class, or the function `of` where that is empty, as parameters."""
        file, node = self._defined[of]
        function = _methods(node).get(method) if method else node
        if self.stays[-1:] != [file]:
            self.stays.append(file)
        if isinstance(function, ast.FunctionDef) and file == self.home and method not in self._seen:
            self._seen.add(method)
            types = _annotated(function) | {"self": of}
            for each in _in_order(function):
                if isinstance(each, ast.Call):
                    self._call(each, types, me)
                for target, value in _pairs(each):
                    types[target] = self._type(value, types)
                    me |= {target} if me & _names(value) else set()

    def _call(self, call: ast.Call, types: dict[str, str], me: set[str]) -> None:
        words = {k.arg or "" for k in call.keywords if me & _names(k.value)}
        places = [k for k, value in enumerate(call.args) if me & _names(value)]
        of, method = getattr(call.func, "id", ""), ""
        if isinstance(call.func, ast.Attribute):
            of, method = self._type(call.func.value, types), call.func.attr
        if (words or places) and of in self._defined:
            node = self._defined[of][1]
            names = [n for n in _annotated(_methods(node).get(method, node)) if n != "self"]
            self.enter(of, method, words | {names[k] for k in places if k < len(names)})

    def _type(self, value: ast.expr, types: dict[str, str]) -> str:
        """Class of an expression; empty where it is not known."""
        if isinstance(value, ast.Call):
            return getattr(value.func, "id", "")
        if isinstance(value, ast.Attribute):
            made = _methods(self._defined.get(self._type(value.value, types), ("", None))[1])
            inside = made.get("__init__")
            kept = {t: v for each in _in_order(inside) for t, v in _pairs(each)} if inside else {}
            own = kept.get(f"self.{value.attr}")
            return self._type(own, _annotated(inside)) if own and inside else ""
        return types.get(ast.unparse(value), "")


def _methods(node: ast.stmt | None) -> dict[str, ast.FunctionDef]:
    body = node.body if isinstance(node, ast.ClassDef) else []
    return {each.name: each for each in body if isinstance(each, ast.FunctionDef)}


def _annotated(node: ast.stmt) -> dict[str, str]:
    """Parameters of a function with their classes, without `| None`."""
    parameters = node.args.args if isinstance(node, ast.FunctionDef) else []
    return {a.arg: ast.unparse(a.annotation or ast.Name("")).split(" |")[0] for a in parameters}


def _names(value: ast.expr) -> set[str]:
    return {ast.unparse(n) for n in ast.walk(value) if isinstance(n, ast.Name | ast.Attribute)}


def _in_order(function: ast.stmt) -> list[ast.Assign | ast.Call]:
    found = [n for n in ast.walk(function) if isinstance(n, ast.Assign | ast.Call)]
    return sorted(found, key=lambda n: (n.lineno, n.col_offset))


def _pairs(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Targets of an assignment, with their values."""
    if isinstance(node, ast.Assign):
        for target in node.targets:
            targets = target.elts if isinstance(target, ast.Tuple) else [target]
            each = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            values = each if len(each) == len(targets) else [node.value] * len(targets)
            yield from zip(map(ast.unparse, targets), values, strict=True)
