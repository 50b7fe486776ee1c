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


class Drawn(dict):
    """Figures by name, each drawn when it is first asked for."""

    def __missing__(self, name):
        self[name] = small_figures.DRAWN[name]()
        return self[name]


@pytest.fixture(scope="session")
def drawn():
    return Drawn()
