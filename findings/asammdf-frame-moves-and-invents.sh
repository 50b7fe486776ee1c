#!/usr/bin/env bash
# asammdf 8.8.28, NumPy 2.4.6, pandas 3.1.1
#
# Guess: `to_dataframe` keeps the time of the file, and has nan where a channel had not begun or had ended.
# Seen:  it holds the first sample backwards to the start of the frame and the last one forwards to its end, and each
#        frame starts at 0. Force that was recorded from 2.5 s to 4.5 s has a value at 0 s in the frame of all
#        channels; in a frame of its own its first sample is at 0 s too, 2.5 s early. `get` says 2.5 s.
#        With use_interpolation=False there is nan, with time_from_zero=False the time of the file.
# Output: force begins at 2.5 s by get, at 0.0 s in its own frame; in the common frame it is 9.0 at 0 s and 7.0 at 5 s
#
# Why: energy from force times speed counts time in which nothing was measured, and frames that are made channel by
# channel and joined are shifted against one another. Neither gives a nan or a warning.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check asammdf==8.8.28 numpy==2.4.6 pandas==3.1.1
cd "$folder"
venv/bin/python - <<'EOF'
import numpy as np
from asammdf import MDF, Signal

with MDF() as mdf:
    mdf.append([Signal(np.array([80.0, 70.0, 60.0, 50.0, 40.0, 30.0]), np.arange(6.0), name="speed")])
    mdf.append([Signal(np.array([9.0, 8.0, 7.0]), np.array([2.5, 3.5, 4.5]), name="force")])
    mdf.save("run.mf4")

with MDF("run.mf4") as mdf:
    first = mdf.get("force").timestamps[0]
    alone = mdf.to_dataframe(channels=["force"])["force"]
    placed = mdf.to_dataframe(channels=["force"], time_from_zero=False)["force"]
    common = mdf.to_dataframe()["force"]
    honest = mdf.to_dataframe(use_interpolation=False)["force"]

assert first == 2.5, first
assert alone.index.tolist() == [0.0, 1.0, 2.0], alone
assert placed.index.tolist() == [2.5, 3.5, 4.5], placed
assert common.notna().all(), common
assert common.loc[[0.0, 1.0, 2.0, 5.0]].tolist() == [9.0, 9.0, 9.0, 7.0], common
assert honest.loc[[0.0, 1.0, 2.0, 5.0]].isna().all(), honest
print(
    f"force begins at {first} s by get, at {alone.index[0]} s in its own frame; "
    f"in the common frame it is {common.loc[0.0]} at 0 s and {common.loc[5.0]} at 5 s"
)
EOF
