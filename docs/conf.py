"""Settings of the documentation site: `make docs` builds it, without the network and with every warning as an error."""

import sys
from importlib.metadata import version as installed_version
from pathlib import Path

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

extensions = ["myst_parser", "sphinx.ext.autodoc", "cyclopts.ext.sphinx"]
exclude_patterns = ["plugins", "results"]
root_doc = "index"

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
    from studies.command_line.catalogue import catalogue

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


def setup(app: object) -> None:
    """Write the pages that follow from the code."""
    page = HERE / "_generated" / "names.md"
    page.parent.mkdir(exist_ok=True)
    text = names_page()
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")
