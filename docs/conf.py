"""Settings of the documentation site: `make docs` builds it without network, and every warning is an error."""

import re
import sys
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx import addnodes
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parents[1]))
from alloc.onboard.columns import TABLES as KNOWN
from alloc.onboard.controllers import CONTROLLERS
from alloc.plant.columns import TABLES as TRUE
from paper_figs import all_figures

project = html_title = "readhesion"
version = release = installed_version("readhesion")
language = "en"
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_show_copyright = html_show_sourcelink = html_copy_source = False

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
nb_execution_mode = "off"  # outputs are stored; tests/docs/test_notebooks.py runs the notebooks
exclude_patterns = ["paper", "pull_request_template.md"]
suppress_warnings = ["toc.not_included"]  # of stored tables, which pages include and link to
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4  # links to headings, as in the plain view of the repository

default_role = "code"  # docstrings put names into single backticks
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"

SHORT = {
    r"(typing\.)?_?Buffer \| _SupportsArray.*?complex \| bytes \| str\]": "ArrayLike",
    r"(numpy\.)?ndarray\[tuple\[.*?\], (numpy\.)?dtype\[(numpy\.)?\w+\]\]": "ndarray",
}
"""Types that are aliases in the code, and that Python shows as what they stand for."""
NUMBER = re.compile(r"\\tag\{(\w+)\}")


def shorten_types(app: Sphinx, domain: str, kind: str, content: addnodes.desc_content) -> None:
    """Call types in signatures as the code calls them."""
    for part in content.parent.findall(addnodes.desc_annotation):
        text = part.astext()
        for pattern, name in SHORT.items():
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


def visit_math(writer: Any, node: nodes.math | nodes.math_block) -> None:
    """Write an equation as MathML, which browsers set themselves; the number of a displayed one beside it."""
    block = isinstance(node, nodes.math_block)
    number = NUMBER.search(node.astext())
    made = tex2mathml(NUMBER.sub("", node.astext()), as_block=block)
    beside = f'<span class="number">({number[1]})</span>' if number else ""
    writer.body.append(f'<div class="equation">{made}{beside}</div>' if block else made)
    raise nodes.SkipNode


def list_quantities(app: Sphinx, page: str, source: list[str]) -> None:
    """Add the columns of all tables, and of the controllers' memories, to the page of quantities."""
    memories = (one.memory for one in CONTROLLERS.values() if one.memory.columns)
    for table in dict.fromkeys((*TRUE, *KNOWN, *memories)):  # controllers may share one
        if page == "quantities":
            rows = [
                f"| `{key}` | {one.unit} | {one.meaning} | {'yes' if one.recorded else ''} | {one.source} |"
                for key, one in table.columns.items()
            ]
            head = f"\n## {table.name}\n\n| column | unit | meaning | recorded | source |\n|---|---|---|---|---|\n"
            source[0] += head + "\n".join(rows) + "\n"


def list_pictures(app: Sphinx, page: str, source: list[str]) -> None:
    """Add the stored pictures to the page of the gallery, each with its caption and the command that draws it."""
    for name, figure in all_figures().items() if page == "gallery" else ():
        path = f"../paper_figs/gallery/{name}.png"
        if Path(app.srcdir, path).is_file():
            caption = figure.caption.replace("|", "\\|")
            picture = f"[![{name}]({path})]({path})"
            source[0] += f"| {picture} | {caption} | `readhesion figures {name}` |\n"


def setup(app: Sphinx) -> dict[str, Any]:
    """Equations as MathML, docstrings and types as they are meant."""
    app.connect("source-read", list_quantities)
    app.connect("source-read", list_pictures)
    app.connect("autodoc-process-docstring", escape_bars)
    app.connect("object-description-transform", shorten_types)
    written = visit_math, None
    app.add_html_math_renderer("mathml", inline_renderers=written, block_renderers=written)
    return {"parallel_read_safe": True, "parallel_write_safe": False}
