"""Links to what is in a checkout and is no page: files are offered as they are, folders are named by their path."""

from pathlib import Path

from docutils import nodes
from pygments.lexers.special import TextLexer
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform


class Folders(SphinxPostTransform):
    """Makes of a link to a folder one to its README, as GitHub does, or text with the folder's path."""

    default_priority = 8  # before MyST resolves its links

    def run(self, **kwargs: object) -> None:
        root = Path(self.env.srcdir)
        for node in list(self.document.findall(pending_xref)):
            here = Path(self.env.doc2path(node.get("refdoc", self.env.docname)))
            path = (here.parent / node["reftarget"]).resolve()
            if not node["reftarget"] or not path.is_dir():
                continue
            if (path / "README.md").exists():
                node["reftarget"] = (path / "README").relative_to(root).as_posix()
                node["refdomain"], node["reftype"] = "std", "doc"
                continue
            named = f"the folder {path.relative_to(root).as_posix()}/ of a checkout"
            node.replace_self(nodes.abbreviation("", "", *node.children, explanation=named))


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_post_transform(Folders)
    app.add_lexer("vector", TextLexer)  # test vectors of the wire's page
    return {"parallel_read_safe": True, "parallel_write_safe": True}
