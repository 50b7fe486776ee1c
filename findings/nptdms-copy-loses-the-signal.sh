#!/usr/bin/env bash
# npTDMS 1.13.0, NumPy 2.4.6
#
# Guess: npTDMS's page on writing copies a file by handing its groups and channels to the writer, and notes that this
#        does not suit scaled channels, whose scale is applied already: so an error, or values that are scaled twice.
# Seen:  neither. The scaled values, 64-bit floats, are written under the type of the counts, 16-bit integers: the first
#        quarter of their bytes is read back as counts and scaled. No error, no warning, the same number of samples.
#        Values and properties handed over by hand are scaled twice. `TdmsWriter.defragment` copies rightly.
# Output: read 72.0 72.1 72.2 72.3; copy 0.0 0.0 0.0 1646.6; by hand 7.2 7.2 7.2 7.2; defragment 72.0 72.1 72.2 72.3
#
# Why: NI's converters store scaled counts. A log whose channels of interest were picked out before it was handed on
# holds another wheel speed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check npTDMS==1.13.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'EOF'
import warnings

import numpy as np
from nptdms import ChannelObject, GroupObject, RootObject, TdmsFile, TdmsWriter

warnings.simplefilter("error")
COUNTS = np.array([720, 721, 722, 723], np.int16)  # of 0.1 km/h
SCALE = {
    "NI_Number_Of_Scales": np.uint32(1),
    "NI_Scale[0]_Scale_Type": "Linear",
    "NI_Scale[0]_Linear_Slope": 0.1,
    "NI_Scale[0]_Linear_Y_Intercept": 0.0,
    "NI_Scale[0]_Linear_Input_Source": np.uint32(0xFFFFFFFF),  # the counts themselves
}


def written(path: str, objects: list) -> np.ndarray:
    """The speed as it is read back from these objects."""
    with TdmsWriter(path) as writer:
        writer.write_segment(objects)
    return TdmsFile.read(path)["log"]["speed"][:]


read = written("log.tdms", [RootObject({}), GroupObject("log"), ChannelObject("log", "speed", COUNTS, SCALE)])
assert np.allclose(read, COUNTS * 0.1), read

log = TdmsFile.read("log.tdms")
speed = log["log"]["speed"]
copy = written("copy.tdms", [RootObject(log.properties), *log.groups(), *log["log"].channels()])
assert len(copy) == len(read)
assert np.allclose(copy, read.view(np.int16)[:4] * 0.1), copy  # the first bytes of the floats

twice = written("twice.tdms", [ChannelObject("log", "speed", speed[:], speed.properties)])
assert np.allclose(twice, read * 0.1), twice

TdmsWriter.defragment("log.tdms", "moved.tdms")
moved = TdmsFile.read("moved.tdms")["log"]["speed"][:]
assert np.allclose(moved, read), moved
rows = {"read": read, "copy": copy, "by hand": twice, "defragment": moved}
print("; ".join(" ".join([name, *(f"{value:.1f}" for value in row)]) for name, row in rows.items()))
EOF
