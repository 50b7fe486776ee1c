"""Settings of the documentation site: `make docs` builds it, without the network and with every warning as an error."""

import inspect
import re
import sys
from collections.abc import Iterator
from functools import reduce
from importlib import import_module
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from pygments.lexers import get_lexer_for_filename
from pygments.util import ClassNotFound
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util.logging import getLogger

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path.insert(0, str(ROOT))

project = "readhesion"
version = release = installed_version("readhesion")
language = "en"
html_title = "readhesion"
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_show_copyright = False
html_show_sourcelink = html_copy_source = False

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.linkcode", "cyclopts.ext.sphinx"]
exclude_patterns = ["plugins", "results", "tables"]
root_doc = "index"

# Notebooks are run at every build: what they show is what the present code gives.
nb_execution_mode = "force"
nb_execution_raise_on_error = True  # a cell that fails ends the build
nb_execution_timeout = 600  # [s] of a cell; the first may compile
nb_output_stderr = "remove"  # such as the line while kernels compile
nb_merge_streams = True

myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
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
    r"Names object at .*": "str",
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


NUMBER = re.compile(r"\\tag\{(\w+)\}")


def visit_math(writer: Any, node: nodes.math | nodes.math_block) -> None:
    """Write an equation as MathML, which browsers set themselves; the number of a displayed one beside it."""
    block = isinstance(node, nodes.math_block)
    number = NUMBER.search(node.astext())
    try:
        made = tex2mathml(NUMBER.sub("", node.astext()), as_block=block)
    except MathError as error:
        getLogger(__name__).warning("math: %s", error, location=node)
        made = ""
    beside = f'<span class="number">({number[1]})</span>' if number else ""
    writer.body.append(f'<div class="equation">{made}{beside}</div>' if block else made)
    raise nodes.SkipNode


named_files: set[str] = set()
"""Files of the repository that pages name and that are no pages themselves."""


def linkcode_resolve(domain: str, info: dict[str, str]) -> str | None:
    """Where the text of a part of the library stands; all of them are listed on pages in one folder."""
    if domain != "py":
        return None
    try:
        part = inspect.unwrap(
            reduce(getattr, info["fullname"].split("."), import_module(info["module"]))
        )
        name = Path(inspect.getsourcefile(part) or "").relative_to(ROOT).as_posix()
        line = inspect.getsourcelines(part)[1]
    except (AttributeError, OSError, TypeError, ValueError):  # a value, or of another library
        return None
    named_files.add(name)
    return f"../source/{name}.html#line-{line}"


def link_sources(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Make inline code that names a file of the repository, or a part of the library, a link to it."""
    objects = app.env.domains.python_domain.objects
    for code in list(doctree.findall(nodes.literal)):
        if isinstance(code.parent, nodes.reference | nodes.title):
            continue
        name, anchor = code.astext(), ""
        own_page = name.removeprefix("docs/").removesuffix(".md")
        if own_page in app.env.found_docs and name.endswith(".md"):
            target = own_page
        elif "/" in name and (ROOT / name).is_file():
            target = f"source/{name}"
            named_files.add(name)
        elif "." in name and name in objects:
            target, anchor = objects[name].docname, f"#{objects[name].node_id}"
        else:
            continue
        uri = app.builder.get_relative_uri(page, target) + anchor
        code.replace_self(nodes.reference("", "", code.deepcopy(), refuri=uri, internal=True))


sidebars: dict[int, str] = {}
"""The contents beside the text of a source, by how many folders it lies down: the same beside each, and long to make."""


def same_sidebar(
    app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: nodes.document | None
) -> None:
    """Make the contents beside sources once."""
    if page.startswith("source/"):
        make, depth = context["toctree"], page.count("/")
        context["toctree"] = lambda **options: (
            sidebars.get(depth) or sidebars.setdefault(depth, make(**options))
        )


def source_pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """A page with the text of each file that is named."""
    for name in sorted(named_files):
        try:
            language = get_lexer_for_filename(name).aliases[0]
        except ClassNotFound:
            language = "text"
        text = (ROOT / name).read_text(encoding="utf-8")
        shown = app.builder.highlighter.highlight_block(
            text, language, linenos="inline", lineanchors="line"
        )
        yield f"source/{name}", {"title": name, "body": f"<h1>{name}</h1>{shown}"}, "page.html"


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages that follow from the code; show types by their names."""
    page = HERE / "_generated" / "names.md"
    page.parent.mkdir(exist_ok=True)
    text = names_page()
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")
    app.connect("autodoc-process-docstring", escape_bars)
    app.connect("object-description-transform", shorten_types)
    app.connect("doctree-resolved", link_sources)
    app.connect("html-collect-pages", source_pages)
    app.connect("html-page-context", same_sidebar, priority=100)  # before the theme asks for it
    written = visit_math, None
    app.add_html_math_renderer("mathml", inline_renderers=written, block_renderers=written)
    return {"parallel_read_safe": True, "parallel_write_safe": False}
