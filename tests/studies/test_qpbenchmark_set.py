"""The MPC's quadratic programs as a test set: in qpbenchmark's format, and other solvers find what the MPC found."""

import ast

import numpy as np
import pandas as pd
import qpsolvers

from studies.peers.qpbenchmark_set import NAME, PER_RUN, programs


def test_other_solvers_agree_with_the_mpc(short):
    """Bounds, convexity, a feasible warm start, and the answer; in some a bound holds, in others none does."""
    found = programs(short.changed(rail=short.rail.model_dump() | {"level": 0.03}))
    assert {kind: one[0].q.size for kind, one in found.items()} == {"unit": 20, "train": 80}
    for kind, every in found.items():
        held = set()
        for one in every[:: len(every) // 40]:
            assert (one.lb <= 0.0).all()
            assert (one.ub >= -1e-12).all()
            assert np.abs(one.P - one.P.T).max() <= 1e-9 * np.abs(one.P).max()
            size = np.linalg.eigvalsh(one.P)
            assert size[0] >= -1e-12 * size[-1]
            problem = qpsolvers.Problem(one.P, one.q, lb=one.lb, ub=one.ub)
            answer = qpsolvers.solve_problem(problem, solver="quadprog").x
            np.testing.assert_allclose(one.x, answer, 1e-6, 1e-7, err_msg=kind)
            free = one.lb < one.ub
            held.add(bool(((one.x <= one.lb) | (one.x >= one.ub))[free].any()))
        assert held == {True, False}, kind


def test_the_command_writes_what_qpbenchmark_reads(call, short_file, tmp_path):
    """As its `ParquetTestSet` and `load_test_set` do; its own package is not in the tests, for it replaces `cpuinfo`."""
    folder = tmp_path / "set"
    code, out, _ = call("export-qps", "--scenario", short_file, "--out", folder)
    assert code == 0
    assert f"{sum(PER_RUN.values())} programs" in " ".join(out.split())
    made = ast.parse((folder / f"{NAME}.py").read_text())
    (kind,) = (one for one in made.body if isinstance(one, ast.ClassDef))
    assert kind.name == NAME.title().replace("_", "")
    assert ast.unparse(kind.bases[0]) == "qpbenchmark.ParquetTestSet"
    table = pd.read_parquet(folder / f"{NAME}.parquet", engine="pyarrow")
    assert list(table) == ["P", "q", "G", "h", "A", "b", "lb", "ub", "name"]
    assert table["name"].nunique() == len(table) == sum(PER_RUN.values())
    assert set(table["q"].map(len)) == {20, 80}
    for row in table.iloc[::9].itertuples():
        assert row.G is row.h is row.A is row.b is None
        hessian = row.P.reshape(row.q.size, row.q.size)
        values = (one.copy() for one in (hessian, row.q))  # what pandas gives is to be read alone
        problem = qpsolvers.Problem(*values, lb=row.lb, ub=row.ub)
        answer = qpsolvers.solve_problem(problem, solver="quadprog")
        assert max(answer.primal_residual(), answer.dual_residual()) < 1e-6
    code, _, err = call("export-qps", "--scenario", "nowhere", "--out", tmp_path)
    assert code == 2
    assert "nowhere" in err
