"""Settings of the documentation site: `make docs` builds it, without the network and with every warning as an error."""

import re
import sys
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path.insert(0, str(ROOT))

project = "readhesion"
version = release = installed_version("readhesion")
language = "en"
html_title = "readhesion"
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["tables.css"]
html_show_copyright = False
html_show_sourcelink = html_copy_source = False

extensions = ["myst_nb", "sphinx.ext.autodoc", "cyclopts.ext.sphinx"]
exclude_patterns = ["plugins", "results", "tables"]
root_doc = "index"

# Notebooks are run at every build: what they show is what the present code gives.
nb_execution_mode = "force"
nb_execution_raise_on_error = True  # a cell that fails ends the build
nb_execution_timeout = 600  # [s] of a cell; the first may compile
nb_output_stderr = "remove"  # such as the line while kernels compile
nb_merge_streams = True

myst_heading_anchors = (
    4  # links to a heading of another page, as the plain view of the repository has them
)

default_role = "code"  # docstrings put names into single backticks
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_default_options = {"members": True}


def names_page() -> str:
    """What `readhesion list` lists, as a page."""
    from studies.command_line.list import catalogue

    lines = [
        "# Names",
        "",
        "Every name that a command takes, as `readhesion list` prints them.",
        "",
    ]
    for kind, entries in catalogue().items():
        lines += [f"## {kind[0].upper()}{kind[1:]}", "", "| name | meaning |", "|---|---|"]
        lines += [f"| `{name}` | {_cell(meaning)} |" for name, meaning in entries.items()] + [""]
    return "\n".join(lines)


def _cell(text: str) -> str:
    """A text in a table's cell: what the markup would read is escaped."""
    for sign in "\\|*_<[":
        text = text.replace(sign, f"\\{sign}")
    return text


SHORT_TYPES = {
    r"(typing\.)?_?Buffer \| _SupportsArray.*?complex \| bytes \| str\]": "ArrayLike",
    r"(numpy\.)?ndarray\[tuple\[.*?\], (numpy\.)?dtype\[(numpy\.)?\w+\]\]": "ndarray",
}
"""Types that are aliases in the code, and that Python shows as what they stand for."""


def shorten_types(app: Sphinx, domain: str, kind: str, content: addnodes.desc_content) -> None:
    """Call types in signatures as the code calls them."""
    for part in content.parent.findall(addnodes.desc_annotation):
        text = part.astext()
        for pattern, name in SHORT_TYPES.items():
            text = re.sub(pattern, name, text)
        if text != part.astext():
            part.children = []
            part += nodes.Text(text)


def escape_bars(
    app: Sphinx, what: str, name: str, item: object, options: object, lines: list[str]
) -> None:
    """Bars of magnitudes, as in |x|, are no markup; those in code stay."""
    for k, line in enumerate(lines):
        parts = line.split("`")
        parts[::2] = [part.replace("|", "\\|") for part in parts[::2]]
        lines[k] = "`".join(parts)


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages that follow from the code; show types by their names."""
    page = HERE / "_generated" / "names.md"
    page.parent.mkdir(exist_ok=True)
    text = names_page()
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")
    app.connect("autodoc-process-docstring", escape_bars)
    app.connect("object-description-transform", shorten_types)
    return {"parallel_read_safe": True}
