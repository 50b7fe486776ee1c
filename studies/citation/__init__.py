"""Which documents a run rests on, and where its values come from."""
