"""Structs of the code as their source has them: which there are, and the words beside fields."""

import ast
import inspect
import io
import tokenize
from collections.abc import Iterator

from msgspec import inspect as types


def structs_of(*first: type) -> Iterator[tuple[type, tuple[types.Field, ...]]]:
    """Every struct of the schema, in the order in which a reader meets them."""
    queue, seen = list(first), set()
    while queue:
        cls = queue.pop(0)
        if cls in seen:
            continue
        seen.add(cls)
        info = types.type_info(cls)
        assert isinstance(info, types.StructType)
        yield cls, info.fields
        queue += [inner for field in info.fields for inner in inner_structs(field.type)]


def inner_structs(kind: types.Type) -> Iterator[type]:
    """Structs inside a type."""
    match kind:
        case types.StructType():
            yield kind.cls
        case types.UnionType():
            for part in kind.types:
                yield from inner_structs(part)
        case types.DictType():
            yield from inner_structs(kind.value_type)
        case types.ListType() | types.VarTupleType():
            yield from inner_structs(kind.item_type)


def comments_of(cls: type) -> dict[str, str]:
    """Text beside, above or as text below each field, or member of an enum, in the code."""
    base = cls.__mro__[1]
    inherited = comments_of(base) if base.__module__.startswith(("drivers", cls.__module__)) else {}
    source = inspect.getsource(cls)
    tree = ast.parse(source).body[0]
    assert isinstance(tree, ast.ClassDef)
    above: dict[int, str] = {}
    beside: dict[int, str] = {}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            alone = not token.line[: token.start[1]].strip()
            (above if alone else beside)[token.start[0]] = token.string.lstrip("# ")
    said = dict(inherited)
    for i, node in enumerate(tree.body):
        match node:
            case ast.AnnAssign(target=ast.Name(id=name)) | ast.Assign(targets=[ast.Name(id=name)]):
                pass
            case _:
                continue
        below = tree.body[i + 1] if i + 1 < len(tree.body) else None
        words = [beside[n] for n in range(node.lineno, (node.end_lineno or 0) + 1) if n in beside]
        line, lead = node.lineno - 1, []
        while line in above:
            lead.insert(0, above[line])
            line -= 1
        match below:
            case ast.Expr(value=ast.Constant(value=str() as text)):
                words.append(" ".join(text.split()))
        said[name] = " ".join([*lead, *words])
    return said
