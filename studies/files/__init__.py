"""Events and trains as TOML."""
