"""Symbols within sentences: pages write x_k, v^2 and sqrt(2b), as sources do; the site shows index, exponent and sign."""

import re
from collections.abc import Iterator

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform

GREEK = {
    "alpha": "α", "beta": "β", "delta": "δ", "gamma": "γ", "kappa": "κ", "lambda": "λ", "mu": "μ", "omega": "ω", "rho": "ρ",
    "tau": "τ", "theta": "θ",
}  # fmt: skip
SIGNS = {"<=": "≤", ">=": "≥", "sqrt": "√", "'": "′"}
SYMBOL = re.compile(
    rf"(?<![\w.])(?P<base>[A-Za-z]|{'|'.join(GREEK)})_(?P<index>\{{[^}}]+\}}|\w+)"
    r"|(?<=[\w)\]|}])\^(?P<exponent>\{[^}]+\}|-?\w+)"
    r"|(?P<sign><=|>=|\bsqrt(?=\()|(?<=\b[A-Za-z])(?<!'[A-Za-z])'+(?![\w']))"
)
UNTOUCHED = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.raw, nodes.comment)


def pieces(text: str) -> Iterator[nodes.Node]:
    """Yield a text with its symbols set."""
    at = 0
    for found in SYMBOL.finditer(text):
        yield nodes.Text(text[at : found.start()])
        at = found.end()
        if base := found["base"]:
            yield nodes.Text(GREEK.get(base, base))
            yield nodes.subscript("", found["index"].strip("{}"))
        elif exponent := found["exponent"]:
            yield nodes.superscript("", exponent.strip("{}").replace("-", "−"))
        else:
            yield nodes.Text("".join(SIGNS[each] for each in re.findall("<=|>=|sqrt|'", found["sign"])))
    yield nodes.Text(text[at:])


class Symbols(SphinxTransform):
    """Sets the symbols of a page's sentences and tables."""

    default_priority = 700

    def apply(self, **kwargs: object) -> None:
        for node in list(self.document.findall(nodes.Text)):
            parents, parent = [], node.parent
            while parent is not None:
                parents.append(parent)
                parent = parent.parent
            if SYMBOL.search(node) and not any(isinstance(each, UNTOUCHED) for each in parents):
                node.parent.replace(node, list(pieces(node.astext())))


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_transform(Symbols)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
