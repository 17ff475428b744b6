"""Make the pictures of docs/plots.md: run the code of the page, and write the figure of each block as its picture.

Run: python examples/pictures.py [FOLDER]
"""

import re
import sys
from pathlib import Path
from typing import Any

from kinseek import plots

DOCS = Path(__file__).resolve().parents[1] / "docs"
PART = re.compile(r"^```python\n(.*?)\n```$|^!\[.*?\]\((.*?\.png)\)$", re.MULTILINE | re.DOTALL)


LARGEST = 140_000
"""[bytes] of a picture; of a larger one 256 colours are kept."""


def small(path: Path) -> None:
    """Write a picture anew that is large."""
    from PIL import Image

    if path.stat().st_size > LARGEST:
        Image.open(path).convert("RGB").quantize(256).save(path, optimize=True)


def main(folder: Path) -> None:
    names: dict[str, Any] = {}
    for code, picture in PART.findall((DOCS / "plots.md").read_text(encoding="utf-8")):
        if code:
            exec(code, names)
            continue
        path = plots.save(names.pop("figure"), folder / Path(picture).name)
        if path.exists():
            small(path)
        print("wrote", path)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS / "pictures")
