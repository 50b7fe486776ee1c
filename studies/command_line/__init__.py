"""The command `readhesion`."""
