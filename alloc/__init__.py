"""The heart: tables, laws, plant, computers on board, rules, simulation."""
