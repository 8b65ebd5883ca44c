"""Files of the page, the policy that it is served under, and the page with a recording in one file (`docs/view.md`)."""

import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

STATIC = Path(__file__).parent / "static"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
}
_IMPORT_MAP = re.compile(r'<script type="importmap">(.*?)</script>', re.DOTALL)
_MAIN = '<script type="module" src="main.js"></script>'
_STYLE = re.compile(r'<link rel="stylesheet" href="([\w./]+)">')
_RELATIVE_IMPORT = re.compile(r'((?:from|import)\s*")\./([\w.]+\.js)(?=")')


class ServedFile(NamedTuple):
    """A file as it goes over HTTP."""

    content_type: str
    content: bytes


@cache
def served_files() -> Mapping[str, ServedFile]:
    """Return all files of the page by the path that they are asked for with; `/` is the page itself."""
    paths = [path for path in sorted(STATIC.rglob("*")) if path.suffix in _TYPES]
    files = {f"/{path.relative_to(STATIC).as_posix()}": _served(path) for path in paths}
    return {"/": files.pop("/index.html"), **files}


def _served(path: Path) -> ServedFile:
    return ServedFile(_TYPES[path.suffix], path.read_bytes())


@cache
def content_security_policy() -> str:
    """Return the Content-Security-Policy header of the served page: only its own files, its own socket and its import map."""
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src 'self' {_source_hash(_import_map(_index()))}",
            "style-src 'self'",
            "connect-src 'self'",
            "img-src 'self' data:",
            "frame-ancestors 'none'",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )


def self_contained(scene_json: str, chunks: Sequence[bytes]) -> str:
    """Return the page with a recording as one HTML file, which opens from a disk and asks the network for nothing.

    scene_json: the scene message, mode "recording"; chunks: the binary messages that answer its chunk requests.
    """
    index = _index()
    modules = {path: file.content.decode() for path, file in served_files().items() if path.endswith(".js")}
    addresses = {_specifier(path): _data_address(source) for path, source in modules.items()}
    entries = ", ".join(f'"{name}": "{address}"' for name, address in addresses.items())
    import_map, start = f'{{"imports": {{{entries}}}}}', 'import "cogrip/main.js";'
    styles = {name: served_files()[f"/{name}"].content.decode() for name in _STYLE.findall(index)}
    policy = "; ".join(
        [
            "default-src 'none'",
            f"script-src data: {_source_hash(import_map)} {_source_hash(start)}",
            f"style-src {' '.join(_source_hash(style) for style in styles.values())}",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )
    packed = ", ".join(f'"{b64encode(chunk).decode()}"' for chunk in chunks)
    recording = f'{{"scene": {scene_json}, "chunks": [{packed}]}}'.replace("<", r"\u003c")
    scripts = (
        f'<script type="application/json" id="recording">{recording}</script>\n<script type="module">{start}</script>\n'
    )
    page = _STYLE.sub(lambda found: f"<style>{styles[found[1]]}</style>", index)
    page = _IMPORT_MAP.sub(lambda _: f'<script type="importmap">{import_map}</script>', page)
    page = page.replace(_MAIN + "\n", "").replace("</body>", scripts + "</body>")
    meta = f'<meta charset="utf-8">\n<meta http-equiv="Content-Security-Policy" content="{policy}">'
    return page.replace('<meta charset="utf-8">', meta).replace("<html", f"<!--\n{_licences()}\n-->\n<html", 1)


def _index() -> str:
    return served_files()["/"].content.decode()


def _import_map(index: str) -> str:
    found = _IMPORT_MAP.search(index)
    assert found, "index.html has an import map"
    return found[1]


def _specifier(path: str) -> str:
    """Return the name by which modules without an address of their own import the one at `path`."""
    packages = {"/vendor/three.module.min.js": "three", "/vendor/uPlot.esm.js": "uplot"}
    return packages.get(path, f"cogrip/{path.rpartition('/')[2]}")


def _data_address(source: str) -> str:
    """Return a module as a data: URL, its relative imports by name."""
    named = _RELATIVE_IMPORT.sub(r"\1cogrip/\2", source)
    return f"data:text/javascript;base64,{b64encode(named.encode()).decode()}"


def _source_hash(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"


def _licences() -> str:
    """Return the licences of the files of others, which go wherever these go."""
    files = sorted(STATIC.glob("vendor/*.LICENSE.txt"))
    return "\n\n".join(f"{file.name.partition('.')[0]}:\n{file.read_text(encoding='utf-8').strip()}" for file in files)
