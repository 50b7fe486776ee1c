"""Real lines and trains: railtoolkit files, and runs over them in minimum time."""
