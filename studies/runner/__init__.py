"""What runs a study: its cells, its rows and their keys, workers, plug-ins."""
