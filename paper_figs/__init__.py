"""Figures of the papers and of the comparison, by topic: data in, figure out."""
