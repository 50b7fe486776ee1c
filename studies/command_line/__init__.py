"""The command `readhesion`."""

import os

# arrays here are walked axle by axle: threads of BLAS would mostly wait for each other, and the cores are for processes
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
