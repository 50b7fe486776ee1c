"""The claims of JP5484215 over random events."""
