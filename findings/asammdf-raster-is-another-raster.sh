#!/usr/bin/env bash
# asammdf 8.8.28, NumPy 2.4.6, pandas 3.1.1
#
# Guess: `mdf.get(name, raster=0.1)` returns samples every 0.1 s, as `to_dataframe` and `resample` do.
# Seen:  where the record lasts a multiple of the raster it returns one sample too few, spread evenly over the record.
#        1 s of a channel gets a sample every 0.1111 s; 2 s of a second one, in the same file, every 0.1053 s.
#        `to_dataframe` and `resample` give 0.1 s from the same file.
# Output: raster 0.1 s: get gives 0.1111 s for 1 s of force, 0.1053 s for 2 s of speed; to_dataframe gives 0.1000 s
#
# Why: a filter or a differentiator set up for the raster runs 11 % off, and two channels fetched one after the other
# and put side by side are up to one period apart. A slip, the difference of two speeds, is small against that.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check asammdf==8.8.28 numpy==2.4.6 pandas==3.1.1
cd "$folder"
venv/bin/python - <<'EOF'
import numpy as np
from asammdf import MDF, Signal

RASTER = 0.1
with MDF() as mdf:
    for name, last in (("force", 1.0), ("speed", 2.0)):
        time = np.linspace(0.0, last, round(100 * last) + 1)  # every 10 ms
        mdf.append([Signal(20.0 - time, time, name=name)])
    mdf.save("run.mf4")

spacing = {}
with MDF("run.mf4") as mdf:
    for name in ("force", "speed"):
        steps = np.diff(mdf.get(name, raster=RASTER).timestamps)
        assert np.ptp(steps) < 1e-9, steps  # evenly
        spacing[name] = steps.mean()
        resampled = np.diff(mdf.resample(RASTER).get(name).timestamps)
        assert np.allclose(resampled, RASTER), resampled
    frame = np.diff(mdf.to_dataframe(raster=RASTER).index)

assert np.allclose(frame, RASTER), frame
assert abs(spacing["force"] - 1.0 / 9.0) < 1e-9, spacing
assert abs(spacing["speed"] - 2.0 / 19.0) < 1e-9, spacing
print(
    f"raster {RASTER} s: get gives {spacing['force']:.4f} s for 1 s of force, "
    f"{spacing['speed']:.4f} s for 2 s of speed; to_dataframe gives {frame.mean():.4f} s"
)
EOF
