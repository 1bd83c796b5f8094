"""Comments of record fields, which hold meaning, unit and source."""

import ast
import inspect
import io
import textwrap
import tokenize

import msgspec


def field_comments(record: type[msgspec.Struct]) -> dict[str, str]:
    """Return the comment of every field, including inherited ones; "" if it has none.

    A comment is at the end of the field, else on the lines above it.
    """
    found: dict[str, str] = {}
    for base in reversed(record.__mro__):
        if issubclass(base, msgspec.Struct) and base is not msgspec.Struct:
            found |= _own_comments(base)
    return {name: found.get(name, "") for name in record.__struct_fields__}


def _own_comments(record: type) -> dict[str, str]:
    source = textwrap.dedent(inspect.getsource(record))
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    comments = {t.start[0]: t.string.lstrip("# ") for t in tokens if t.type == tokenize.COMMENT}
    (node,) = ast.parse(source).body
    assert isinstance(node, ast.ClassDef)
    lines = source.splitlines()
    result = {}
    for item in node.body:
        if isinstance(item, ast.AnnAssign):
            found = [comments.get(item.end_lineno or 0, "").partition("noqa")[0]]
            line = item.lineno - 1
            while not found[-1] and lines[line - 1].lstrip().startswith("#"):
                found.insert(0, comments[line])
                line -= 1
            result[ast.unparse(item.target)] = " ".join(found).strip()
    return result
