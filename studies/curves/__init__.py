"""Rules and controllers under other adhesion curves."""
