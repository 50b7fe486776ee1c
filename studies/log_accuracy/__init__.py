"""How right the figures of logs are that have the usual defects of recorders."""
