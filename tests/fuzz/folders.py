"""Small files, written and removed many thousand times."""

from __future__ import annotations

import os
from pathlib import Path


def write_files(folder: Path, files: dict[str, bytes]) -> None:
    root, made = str(folder), set()
    for name, content in files.items():
        parent = os.path.dirname(name)
        if parent and parent not in made:
            os.makedirs(os.path.join(root, parent), exist_ok=True)
            made.add(parent)
        with open(os.path.join(root, name), "wb", buffering=0) as file:
            file.write(content)


def remove_files(folder: Path) -> None:
    for entry in os.scandir(folder):
        if entry.is_dir(follow_symlinks=False):
            remove_files(Path(entry.path))
            os.rmdir(entry.path)
        else:
            os.unlink(entry.path)
