"""The comparison of rules and controllers over the shipped slip events."""
