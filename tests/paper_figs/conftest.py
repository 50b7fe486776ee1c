"""Small runs and every figure from them, once for all tests."""

import pytest

from tests.paper_figs import small_figures


@pytest.fixture(scope="session")
def source():
    return small_figures.source()


@pytest.fixture(scope="session")
def runs():
    return small_figures.runs()


@pytest.fixture(scope="session")
def logged():
    return small_figures.logged()


@pytest.fixture(scope="session")
def line_run():
    return small_figures.line_run()


@pytest.fixture(scope="session")
def drawn():
    """Every figure by name."""
    return {name: draw() for name, draw in small_figures.DRAWN.items()}
