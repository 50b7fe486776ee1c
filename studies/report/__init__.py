"""A comparison as one HTML file that opens offline: table, gain against headroom, replays, provenance, citations."""
