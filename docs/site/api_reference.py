"""Reference of `cogrip.api`, of signatures and docstrings as they stand in the sources: nothing of cogrip is imported."""

import re
from collections.abc import Iterable, Iterator
from functools import cache
from inspect import cleandoc
from pathlib import Path

from griffe import Alias, Attribute, Class, Function, Module, Object, visit
from sphinx.application import Sphinx

PAGE = "docs/api_reference"
MODULE = "cogrip.api"
SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)
ROW = re.compile(r"^([\w*][\w, .*]*?) {2,}(\S.*)$")


def objects(root: Path) -> tuple[Module, list[Object]]:
    """Return the module, and what it offers in the order of its `__all__`."""
    module = _module(MODULE, root)
    return module, [_defined(module.imports[str(name)], root) for name in module.exports or ()]


@cache
def _module(path: str, root: Path) -> Module:
    """Return a module by its dotted path, from the folder of the checkout that has its part of the package."""
    stem = root / path.split(".")[1] / path.replace(".", "/")
    file = stem / "__init__.py" if stem.is_dir() else stem.with_suffix(".py")
    return visit(path, file, file.read_text(encoding="utf-8"))


def _defined(path: str, root: Path) -> Object:
    """Return what a dotted path names, from the module in which it is defined."""
    place, _, name = path.rpartition(".")
    found = _module(place, root).members[name]
    return _defined(found.target_path, root) if isinstance(found, Alias) else found


def entries(block: str) -> Iterator[str]:
    """Yield the entries of a section of a docstring, names with text indented below them, as items of a list."""
    name, words = "", list[str]()
    for line in [*block.splitlines(), "end"]:
        if line.startswith(" ") or not line.strip():
            words.append(line.strip())
            continue
        if name:
            yield f"- {', '.join(f'`{each.strip()}`' for each in name.split(','))}: {' '.join(words).strip()}"
        name, words = line, []


def rows(lines: Iterable[str]) -> Iterator[str]:
    """Yield lines, those of a table "name  text" as items of a list; what is indented goes on with the item before."""
    item = False
    for line in lines:
        found = ROW.match(line)
        if found:
            yield f"- `{found[1]}`: {found[2]}"
        elif item and line.startswith("   "):
            yield f"  {line.strip()}"
        else:
            yield line
        item = bool(found) or (item and line.startswith("   "))


def markdown(docstring: str) -> str:
    """Return a docstring as Markdown."""
    first, *rest = SECTION.split(cleandoc(docstring))
    parts = ["\n".join(rows(first.splitlines()))]
    for title, text in zip(rest[::2], rest[1::2], strict=True):
        body, _, after = re.sub(r"\n\n(?=\S)", "\n\0", text.strip("\n"), count=1).partition("\0")
        parts += [f"**{title}**", "\n".join(entries(body)), "\n".join(rows(after.splitlines()))]
    text = "\n\n".join(part.rstrip() for part in parts if part.strip())
    return re.sub(r"(?:^ {4}.*\n?|^\n(?= {4}))+", fenced, f"{text}\n", flags=re.MULTILINE)


def fenced(found: re.Match[str]) -> str:
    text = cleandoc(f"\n{found[0]}")
    language = "python" if re.search(r"^(import|with|from) ", text, re.MULTILINE) else "text"
    return f"```{language}\n{text}\n```\n"


def directive(kind: str, signature: str, body: str, depth: int, *options: str) -> str:
    mark = "`" * depth
    return "\n".join([f"{mark}{{py:{kind}}} {signature}", *options, "", body, mark, ""])


def signature(function: Function, name: str) -> str:
    """Return name, parameters and result of a function."""
    parts, starred = [], False
    for each in function.parameters:
        kind = each.kind.value if each.kind else ""
        if each.name in ("self", "cls") and not parts:
            continue
        if kind == "keyword-only" and not starred:
            parts.append("*")
        starred = starred or kind in ("keyword-only", "variadic positional")
        star = {"variadic positional": "*", "variadic keyword": "**"}.get(kind, "")
        typed = f": {each.annotation}" if each.annotation else ""
        default = f" = {each.default}" if each.default is not None and not star else ""
        parts.append(f"{star}{each.name}{typed}{default}")
    positional = [each for each in function.parameters if each.kind and each.kind.value == "positional-only"]
    if positional:
        parts.insert(len([each for each in positional if each.name not in ("self", "cls")]), "/")
    result = f" -> {function.returns}" if function.returns and function.name != "__init__" else ""
    return f"{name}({', '.join(parts)}){result}"


def members(kind: Class) -> Iterator[str]:
    """Yield what a class has for its user: methods with a text, properties, fields."""
    for name, each in kind.members.items():
        if name.startswith("_") or each.is_alias:
            continue
        body = markdown(each.docstring.value) if each.docstring else ""
        if isinstance(each, Function):
            options = [":async:"] if "async" in each.labels else []
            yield directive("method", signature(each, name), body, 4, *options)
        elif isinstance(each, Attribute):
            kind_of = "property" if "property" in each.labels else "attribute"
            options = [f":type: {each.annotation}"] if each.annotation else []
            if each.value is not None and kind_of == "attribute":
                options.append(f":value: {each.value}")
            yield directive(kind_of, name, body, 4, *options)


def text_of(each: Object) -> str:
    body = markdown(each.docstring.value) if each.docstring else ""
    if isinstance(each, Class):
        made = each.members.get("__init__")
        head = signature(made, each.name) if isinstance(made, Function) else each.name
        return directive("class", head, "\n".join([body, *members(each)]), 5)
    assert isinstance(each, Function)
    return directive("function", signature(each, each.name), body, 5)


def reference(root: Path) -> str:
    """Return the reference as MyST Markdown."""
    module, found = objects(root)
    parts = [f"```{{py:module}} {MODULE}\n```", markdown(module.docstring.value if module.docstring else "")]
    for title, wanted in (("Functions", Function), ("Classes", Class)):
        parts.append(f"## {title}")
        parts += [text_of(each) for each in found if isinstance(each, wanted)]
    return "\n\n".join(parts)


def add(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put the reference into its page, which tells GitHub's readers how to get it."""
    if docname == PAGE:
        title = source[0].splitlines()[0]
        source[0] = f"{title}\n\n{reference(Path(app.srcdir))}\n"


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("source-read", add)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
