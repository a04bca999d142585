"""glTF: bodies that move, with materials, in one binary file (Khronos, glTF 2.0 Specification, 2021)."""

import io
import json
import struct
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .drawn import DrawnMesh, free_name, linear

MOST_BYTES = 0xFFFFFFFF
"""Size of the largest file: it is stored in 32 bits."""
MORPHED = ("POSITION", "NORMAL", "COLOR_0")
"""What changes from frame to frame."""
VERTICES, INDICES = 34962, 34963
"""Targets of buffer views, as OpenGL numbers them."""


def write_glb(path: Path, times: Sequence[float], frames: Iterable[list[DrawnMesh]]) -> None:
    """Write frames as one animated glTF file: a node for each body, and a morph target for each further frame.

    Between frames vertices move straight. `times` are those of the frames [s]; the animation starts at 0. Raise
    ValueError if the file would be larger than glTF allows.
    """
    file, count = _Binary(), len(times) - 1
    parts = list[
        tuple[dict[str, Any], dict[str, NDArray]]
    ]()  # of each mesh: what glTF calls a primitive, first frame
    nodes, meshes, moving = [], [], []
    for number, frame in enumerate(frames):
        if number == 0:
            _check_size(frame, count)
            parts = [file.primitive(mesh) for mesh in frame]
            for name, body in groupby(zip(frame, parts, strict=True), key=lambda one: one[0].name):
                drawn, primitives = zip(*body, strict=True)
                if count and drawn[0].moves:
                    moving.append(len(nodes))
                nodes.append({"name": name, "mesh": len(nodes)})
                meshes.append({"name": name, "primitives": [primitive for primitive, _ in primitives]})
                meshes[-1]["extras"] = {
                    "targetNames": [f"{time:.6g} s" for time in times[1:]]
                }  # Blender shows them
            continue
        for mesh, (primitive, base) in zip(frame, parts, strict=True):
            if mesh.moves:
                changed = {kind: values - base[kind] for kind, values in _arrays(mesh).items() if kind in MORPHED}
                target = {kind: file.array(values) for kind, values in changed.items()}
                primitive.setdefault("targets", []).append(target)
    document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "msdwarp"}, "scene": 0}
    document |= {
        "scenes": [{"nodes": list(range(len(nodes)))}] if nodes else [{}],
        "nodes": nodes,
        "meshes": meshes,
    }
    if moving:
        weights = np.eye(count + 1, count, -1, dtype=np.float32)  # in frame k target k alone counts
        start = file.array(np.subtract(times, times[0]).astype(np.float32), None)
        sampler = {"input": start, "output": file.array(weights.ravel(), None)}
        channels = [{"sampler": 0, "target": {"node": node, "path": "weights"}} for node in moving]
        document["animations"] = [{"name": "motion", "samplers": [sampler], "channels": channels}]
    file.write(path, document)


def _check_size(meshes: list[DrawnMesh], count: int) -> None:
    """Raise ValueError if meshes with `count` further frames would not fit into a file."""
    size = count * sum(len(mesh.points) * (36 if mesh.color.ndim > 1 else 24) for mesh in meshes if mesh.moves)
    if size > MOST_BYTES:
        every = -(-size // MOST_BYTES)
        raise ValueError(
            f"to is 'glb', whose files are at most {MOST_BYTES / 1e9:.1f} GB large, and these {count + 1} frames "
            f"take {size / 1e9:.1f} GB: take every {every} of them (--every {every}), or fewer"
        )


def _arrays(mesh: DrawnMesh) -> dict[str, NDArray[np.float32]]:
    """Return what glTF stores of the vertices of a mesh in this frame, by glTF's names."""
    stored = {"POSITION": np.array(mesh.points, np.float32)}
    if mesh.normals is not None:
        length = np.linalg.norm(mesh.normals, axis=1, keepdims=True)
        # The vertices of a hidden triangle are in one point and have no normals; glTF wants some.
        normals = np.where(length > 0, mesh.normals / np.maximum(length, 1e-30), [0, 1, 0])
        stored["NORMAL"] = normals.astype(np.float32)
    stored["TEXCOORD_0"] = (np.array([0.0, 1.0]) + [1, -1] * mesh.uv).astype(np.float32)  # v from the top
    if mesh.texture is None and mesh.color.ndim > 1:
        stored["COLOR_0"] = linear(mesh.color).astype(np.float32)
    return stored


class _Binary:
    """The arrays, images and materials of a file, each stored once."""

    def __init__(self) -> None:
        self._data = list[bytes]()
        self._size = 0
        self._lists: dict[str, list[Any]] = {
            name: [] for name in ("bufferViews", "accessors", "materials", "textures", "images")
        }
        self._known: dict[Any, int] = {}

    def _added(self, kind: str, entry: dict[str, Any]) -> int:
        self._lists[kind].append(entry)
        return len(self._lists[kind]) - 1

    def _view(self, data: bytes, target: int | None = None) -> int:
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": len(data)}
        padded = data + bytes(-len(data) % 4)
        self._data.append(padded)
        self._size += len(padded)
        return self._added("bufferViews", view if target is None else view | {"target": target})

    def array(self, values: NDArray, target: int | None = VERTICES) -> int:
        """Store an array of float32 or uint32, of shape [any] or [any, k]; return the number of its accessor."""
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        entry = {"componentType": 5125 if values.dtype == np.uint32 else 5126, "type": kind, "count": len(values)}
        rows = values.reshape(len(values), -1)
        entry |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self._added("accessors", entry | {"bufferView": self._view(values.tobytes(), target)})

    def primitive(self, mesh: DrawnMesh) -> tuple[dict[str, Any], dict[str, NDArray[np.float32]]]:
        """Store a mesh; return its entry, and its arrays."""
        base = _arrays(mesh)
        entry: dict[str, Any] = {"attributes": {kind: self.array(values) for kind, values in base.items()}}
        entry["indices"] = self.array(mesh.triangles.ravel().astype(np.uint32), INDICES)
        return entry | {"material": self._material(mesh)}, base

    def _material(self, mesh: DrawnMesh) -> int:
        """Store the material of a mesh, unless an equal one is; return its number."""
        if mesh.material in self._known:
            return self._known[mesh.material]
        white = mesh.texture is not None or mesh.color.ndim > 1
        paint: dict[str, Any] = {"metallicFactor": mesh.metallic, "roughnessFactor": mesh.roughness}
        paint["baseColorFactor"] = [*([1.0] * 3 if white else linear(mesh.color).tolist()), mesh.opacity]
        if mesh.texture is not None:
            Image.fromarray(np.ascontiguousarray(mesh.texture)).save(png := io.BytesIO(), "png")
            image = self._added("images", {"mimeType": "image/png", "bufferView": self._view(png.getvalue())})
            paint["baseColorTexture"] = {"index": self._added("textures", {"source": image})}
        blend = "OPAQUE" if mesh.opacity == 1 else "BLEND"
        name = free_name(mesh.name, [one["name"] for one in self._lists["materials"]])
        shade = {"name": name, "pbrMetallicRoughness": paint, "alphaMode": blend, "doubleSided": True}
        self._known[mesh.material] = self._added("materials", shade)
        return self._known[mesh.material]

    def write(self, path: Path, document: dict[str, Any]) -> None:
        """Write the file: its header, the document, and the data."""
        document |= self._lists | {"buffers": [{"byteLength": self._size}] if self._size else []}
        document = {
            name: values for name, values in document.items() if values not in ([], {})
        }  # none may be empty
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        chunks = [struct.pack("<I4s", len(text), b"JSON"), text]
        if self._size:
            chunks += [struct.pack("<I4s", self._size, b"BIN\0"), *self._data]
        with path.open("wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, 12 + sum(map(len, chunks))))
            file.writelines(chunks)
