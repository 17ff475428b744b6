"""Read every bundled arm and write its JSON file, see `bundled`: ``python -m kinseek.robots.prepare_catalog``."""

from __future__ import annotations

import json

from .bundled import as_json
from .catalog import catalog_entry, catalog_names, catalog_path
from .urdf import read_urdf


def main() -> None:
    """Write the JSON file of every arm."""
    for name in catalog_names():
        path, entry = catalog_path(name), catalog_entry(name)
        data = as_json(read_urdf(path, entry.base, entry.tip), path)
        lines = ",\n".join(f" {json.dumps(key)}: {json.dumps(value)}" for key, value in data.items())
        path.with_suffix(".json").write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
        print(path.with_suffix(".json"))


if __name__ == "__main__":
    main()
