"""Figures of the papers, by topic and by source, over one style."""

from importlib import import_module

from paper_figs.style import Drawing

MODULES = ("model", "event", "sharing", "jp5484215", "jp4209318", "rtri", "readhesion_paper", "jph07322414")  # fmt: skip


def all_figures() -> dict[str, Drawing]:
    """Every figure by its name, those of studies too."""
    found: dict[str, Drawing] = {}
    for name in MODULES:
        found |= import_module(f"paper_figs.{name}").FIGURES
    return found
