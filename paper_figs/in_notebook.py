"""Figures in notebooks: they are shown without pyplot, which the figures here do not use."""

import sys
from typing import Any

from matplotlib.figure import Figure

FORMATS = ("image/png", "image/svg+xml", "image/jpeg", "application/pdf")
"""What a notebook may show a figure as."""


def show_figures() -> None:
    """In a notebook, let a Matplotlib figure show as a picture; a choice that was made before stands.

    IPython does so only once pyplot has been imported.
    """
    if "IPython" not in sys.modules:
        return
    from IPython.core.getipython import get_ipython
    from IPython.core.pylabtools import select_figure_formats

    shell: Any = get_ipython()  # IPython is not installed where types are checked
    if shell is None:
        return
    formatters = shell.display_formatter.formatters
    if not any(Figure in formatters[one] for one in FORMATS if one in formatters):
        select_figure_formats(shell, {"png"})
