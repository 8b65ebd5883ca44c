"""Settings of the pages that `python3 dev.py site` builds of docs/ and README.md: Sphinx, MyST and Furo.

Sources are read where they are, so that a link leads to the same place here and on GitHub. What GitHub would show as text of
a program, the navigation and the reference that docstrings make, is added as a page is read.
"""

import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE))

project = "cogrip"
author = "the authors of cogrip"
release = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
language = "en"
smartquotes = False  # an apostrophe may be a derivative

extensions = ["myst_parser", "mathml", "plain_mathematics", "navigation", "api_reference", "files_of_the_checkout"]
root_doc = "README"
include_patterns = ["README.md", "CHANGELOG.md", "docs/**.md", "protocol/SPEC.md"]
exclude_patterns = [
    ".*",
    "**/.*",
    "build",
    "dist",
    "runs",
    "studies",
    "sweeps",
    "tests",
    "view",
    "compiled",
    "docs/site",
]
source_suffix = {".md": "markdown"}

myst_heading_anchors = 6  # by GitHub's rules
myst_fence_as_directive = {"math"}
myst_all_links_external = False
highlight_language = "text"
suppress_warnings = ["myst.header"]  # a page may begin with a heading of any level, as GitHub lets it

html_theme = "furo"
html_title = "cogrip"
html_math_renderer = "mathml"
html_baseurl = ""
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_copyright = False
html_use_index = True
html_domain_indices = False
html_scaled_image_link = False
html_theme_options = {"navigation_with_keys": False, "footer_icons": []}
python_maximum_signature_line_length = 80
add_module_names = False
toc_object_entries_show_parents = "hide"
