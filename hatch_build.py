"""Put the one name a second time into wheels, as a stub package: a single file cannot carry `py.typed` (PEP 561)."""

import shutil
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class StubPackage(BuildHookInterface):
    """Called by hatchling; a file that `force-include` in pyproject.toml renamed would be missing under its own name."""

    def initialize(self, version, build_data):
        """Copy readhesion.py, of an editable install too; `make setup` does it again when the file has changed."""
        stub = Path(self.root, "build", "__init__.pyi")
        stub.parent.mkdir(exist_ok=True)
        shutil.copy(Path(self.root, "readhesion.py"), stub)
        build_data["force_include"][str(stub)] = "readhesion-stubs/__init__.pyi"
        if version == "standard":  # an editable install reads the rows of the clone
            build_data["force_include"]["docs/tables/benchmark.parquet"] = (
                "studies/benchmark.parquet"
            )
