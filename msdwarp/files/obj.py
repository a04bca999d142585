"""OBJ: bodies of a frame with normals, materials and groups, in Wavefront's formats .obj and .mtl."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .drawn import DrawnMesh, as_word


def write_obj(path: Path, meshes: Sequence[DrawnMesh], names: dict[Any, str], library: str) -> None:
    """Write meshes; each body is an object and a group. `names` are those of materials in the file `library`.

    Colors that differ from vertex to vertex follow the coordinates, as several programs read them.
    """
    with path.open("w", encoding="utf-8") as file:
        file.write(f"# by msdwarp\nmtllib {library}\n")
        first, body = 1, None
        for mesh in meshes:
            if mesh.name != body:
                body = mesh.name
                file.write(f"o {as_word(body)}\ng {as_word(body)}\n")
            painted = mesh.texture is None and mesh.color.ndim > 1
            _lines(file, "v", np.hstack([mesh.points, mesh.color]) if painted else mesh.points)
            _lines(file, "vt", mesh.uv)
            if mesh.normals is not None:
                _lines(file, "vn", mesh.normals)
            file.write(f"usemtl {names[mesh.material]}\n")
            corner = "{0}/{0}" if mesh.normals is None else "{0}/{0}/{0}"
            for row in (mesh.triangles + first).tolist():
                file.write(f"f {' '.join(map(corner.format, row))}\n")
            first += len(mesh.points)


def write_mtl(path: Path, materials: dict[str, DrawnMesh], textures: Path) -> None:
    """Write materials, by name as meshes that have them; images go into the folder `textures` beside the file.

    Roughness and metalness are `Pr` and `Pm`, which Blender reads too.
    """
    with path.open("w", encoding="utf-8") as file:
        for name, mesh in materials.items():
            plain = mesh.texture is None and mesh.color.ndim == 1
            color = " ".join(f"{x:.6g}" for x in (mesh.color.tolist() if plain else (1.0, 1.0, 1.0)))
            file.write(f"newmtl {name}\nKd {color}\nKs{f' {mesh.gloss:.6g}' * 3}\nd {mesh.opacity:.6g}\n")
            file.write(f"Pr {mesh.roughness:.6g}\nPm {mesh.metallic:.6g}\n")
            if mesh.texture is not None:
                textures.mkdir(exist_ok=True)
                Image.fromarray(np.ascontiguousarray(mesh.texture)).save(textures / f"{name}.png")
                file.write(f"map_Kd {textures.name}/{name}.png\n")


def _lines(file: TextIO, word: str, values: NDArray) -> None:
    """Write rows of numbers, with all digits of float32, each after a word."""
    form = f"{word} {' '.join(['%.9g'] * values.shape[1])}\n"
    for row in values.astype(np.float32).tolist():
        file.write(form % tuple(row))
