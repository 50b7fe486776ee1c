"""Tests of parts of the compiled loop as plain Python; `tests/test_uncompiled.py` runs them with Numba switched off."""

import numba

from tests.mpc.conftest import make_context

__all__ = ["make_context"]

collect_ignore_glob = [] if numba.config.DISABLE_JIT else ["test_*.py"]
