"""Lines and trains of railtoolkit, as YAML: schema, reading, and what has to be assumed of a train."""
