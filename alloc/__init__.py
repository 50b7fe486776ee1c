"""The train, what runs on board, and the rules that share adhesion among its cars."""

from alloc import compilation as compilation  # first: it chooses Numba's cache folder
