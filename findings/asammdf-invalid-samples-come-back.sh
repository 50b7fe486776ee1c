#!/usr/bin/env bash
# asammdf 8.8.28, NumPy 2.4.6, pandas 3.1.1, SciPy 1.17.1
#
# Guess: a sample that the recorder marked invalid (MDF 4's invalidation bits) is left out, or nan, wherever it is read.
# Seen:  one library, one channel, three answers. `get` leaves the samples out. `select`, `iter_channels` and the export
#        to MAT return what was stored, here 65535 of a lost sensor, though `select` has the marks in
#        `invalidation_bits`. `to_dataframe` fills the gap: it holds integers and draws a straight line through floats.
# Output: stored 0 10 65535 65535 40, two marked: get 0 10 40; select and MAT 0 10 65535 65535 40; frame 0 10 10 10 40
#
# Why: readhesion control is judged with a lost axle-speed sensor, too. By the call that loads the log, the loss is a
# gap, a wheel that spins at 65535, or a wheel that rolls on smoothly.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check asammdf==8.8.28 numpy==2.4.6 pandas==3.1.1 scipy==1.17.1
cd "$folder"
venv/bin/python - <<'EOF'
import numpy as np
from asammdf import MDF, Signal
from scipy.io import loadmat

STORED, LOST = np.array([0, 10, 65535, 65535, 40], np.uint16), np.array([0, 0, 1, 1, 0], bool)
with MDF() as mdf:
    for name, samples in (("count", STORED), ("ramp", STORED.astype(float))):
        mdf.append([Signal(samples, np.arange(5.0), name=name, invalidation_bits=LOST)])
    mdf.save("run.mf4")

with MDF("run.mf4") as mdf:
    kept = mdf.get("count")
    chosen = mdf.select(["count"])[0]
    walked = next(iter(mdf.iter_channels()))
    frame = mdf.to_dataframe()
    mdf.export("mat", filename="run.mat")
(exported,) = [value.ravel() for key, value in loadmat("run.mat").items() if key.endswith("count")]

assert kept.samples.tolist() == [0, 10, 40], kept.samples
assert kept.timestamps.tolist() == [0.0, 1.0, 4.0], kept.timestamps
for samples in (chosen.samples, walked.samples, exported):
    assert np.array_equal(samples, STORED), samples
assert np.array_equal(chosen.invalidation_bits, LOST), chosen.invalidation_bits
assert frame["count"].tolist() == [0, 10, 10, 10, 40], frame
assert np.allclose(frame["ramp"], [0.0, 10.0, 20.0, 30.0, 40.0]), frame


def shown(samples) -> str:
    return " ".join(str(int(value)) for value in samples)


print(
    f"stored {shown(STORED)}, two marked: get {shown(kept.samples)}; "
    f"select and MAT {shown(chosen.samples)}; frame {shown(frame['count'])}"
)
EOF
