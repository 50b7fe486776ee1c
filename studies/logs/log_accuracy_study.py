"""How right the figures of logs are that recorders have written with their usual defects."""

import pandas as pd

from studies.core.cell import Task
from studies.core.claims import ABOUT, AT_LEAST, AT_MOST, Claim, conjunction, how_many
from studies.core.statement import Statement, in_words
from studies.core.study import EachEvent, Study
from studies.logs.spoiled_logs import CLEAN, LITTLE, LOGS, PLAIN, SLIPS, TOLERANCE, rows_of

# Claims of the sweep `log-accuracy`; a log is an event.

ENOUGH_RIGHT, MOST_SILENT = 0.90, 0.01
"""Share of spoiled logs that should be answered rightly, and of those that may be wrong without a word."""
COVERED, EITHER_WAY = 0.90, 0.04
"""Share of the logs with a Q that should lie within twice the stated error, and by how much it may differ."""
RIGHT = (
    f"right: Q within {TOLERANCE:.0%} or {LITTLE:g} kJ of the simulator's; all shares are of all logs, "
    "those that are refused too"
)
TRUTHS = ("right", "proper", "slips_right", "silent", "covered", "remarked", "refused", "coupled")
"""Columns that are true or not; nan where nothing was asked."""
SPOILED = f"defect != {CLEAN}"
WORST, USUAL = "no fault of a log may come to this", "what a user can rely on"


def _clean(name: str, what: str, coupled: int) -> Claim:
    return Claim(
        name, f"{what} gives the simulator's Q within {TOLERANCE:.0%}", "right == 0", AT_MOST, exact=True,
        only=f"defect == {CLEAN} and coupled == {coupled}", reason="without a defect nothing excuses a wrong figure",
        show=how_many("in", "logs"), method=f"{RIGHT}; holds if it does in every log",
        numbers={"share right": "right", "error of Q, share": "error", "share with a fault found": "remarked"},
    )  # fmt: skip


CLAIMS = (
    _clean("clean", "a log without a defect", 0),
    _clean("clean-coupled", "a log without a defect, of a train whose couplers give way,", 1),
    Claim(
        "right", f"of logs with a usual defect {ENOUGH_RIGHT:.0%} or more are right or properly refused", "right or proper",
        AT_LEAST, ENOUGH_RIGHT, only=SPOILED, reason=USUAL,
        numbers={
            "share right": "right", "share properly refused": "proper",
            "right, rigid trains": "right if coupled == 0", "right, trains whose couplers give way": "right if coupled",
            "right, in the project's own form": f"right if form == '{PLAIN}'",
            "right, in another form": f"right if form != '{PLAIN}'",
        },
        method=f"{RIGHT}; properly refused: mistaken units, and worn wheels that never roll",
    ),
    Claim(
        "slips",
        f"of logs with a usual defect {ENOUGH_RIGHT:.0%} or more have the slips of the clean log or are properly refused",
        "slips_right or proper", AT_LEAST, ENOUGH_RIGHT, only=SPOILED, reason=USUAL,
        numbers={"share slips_right": "slips_right"}, method=f"as many but for {SLIPS}, or a twelfth",
    ),
    Claim(
        "silent", f"of logs with a usual defect {MOST_SILENT:.0%} or less are wrong and nothing is said of it", "silent",
        AT_MOST, MOST_SILENT, only=SPOILED, reason=WORST, numbers={"share silent": "silent"},
        method="silent: wrong, beyond twice the stated error, and no remark names the defect or finds another fault",
    ),
    Claim(
        "stated",
        f"{COVERED - EITHER_WAY:.0%} to {COVERED + EITHER_WAY:.0%} of the logs with a Q lie within twice the error that is "
        "stated",
        "covered", ABOUT, COVERED, EITHER_WAY, only="refused == 0", exact=True, show=in_words("with {:.1%}"),
        reason="a stated error that is right covers as many",
        numbers={"share within twice the stated error": "covered", "of the wrong ones": "covered if right == 0"},
        method="holds if the share lies there",
    ),
    Claim(
        "refused", "no log is refused but for mistaken units and worn wheels", "refused and proper == 0", AT_MOST,
        exact=True, reason="a reader that refuses is no reader", show=how_many("in", "logs"),
        numbers={"share refused": "refused", "share refused, mistaken units": "refused if mistaken_units"},
        method="holds if no other is refused",
    ),
)  # fmt: skip
BY_DEFECT = {"right": "right", "slips": "slips_right", "silent": "silent"}
"""Statement -> the column whose share is told of each defect."""


def log_accuracy_statements(table: pd.DataFrame) -> list[Statement]:
    """Of clean logs, of spoiled ones, of wrong figures that nothing is said of, of stated errors and of what is refused."""
    logs = table.assign(
        **{name: table[name].astype(float) > 0.0 for name in TRUTHS},
        mistaken_units=table["defect"].str.contains(" called "),
    )
    spoiled = logs[logs["defect"] != CLEAN].groupby("defect", sort=False)
    told = {
        name: {f"{column}, {defect}": own[column] for defect, own in spoiled}
        for name, column in BY_DEFECT.items()
    }
    return [conjunction(logs, claim, numbers=told.get(claim.name, {})) for claim in CLAIMS]


def cells(seed: int, k: int, logs: int = LOGS) -> list[Task]:
    """Run `k` and its logs."""
    return [Task(f"{seed}/{k:04d}/{logs}", rows_of, (seed, k, logs), (("seed", seed),))]


LOG_ACCURACY = Study(
    name="log-accuracy",
    question="how right figures from logs are that recorders wrote with drawn defects, and what is said of wrong ones",
    default_events=68,
    cells=EachEvent(cells),
    judge=log_accuracy_statements,
    claims=CLAIMS,
)
