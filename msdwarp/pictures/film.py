"""Films and frames on disk."""

import importlib.util
import io
import itertools
import math
import struct
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import checks
from ..disk import writing
from ..runtime import cores

try:
    from isal import isal_zlib as zlib
except ImportError:  # no ISA-L for this processor: slower, the same pictures
    import zlib

MOST_WRITERS = 8
"""Maximal number of threads that compress pictures: a limit of memory."""
SMEARED = 16
"""Margin around changes that a WebP film also stores [pixels]: compression smears colors that far."""
FRAME_FORMATS = ("png", "none")
FILM_FORMATS = ("webp", "mp4", "gif", "none")
Picture = NDArray[np.uint8]


def check_formats(frames: str, video: str, transparent: bool = False) -> None:
    """Raise ValueError unless both formats are known, mp4 can be written if requested, and hold transparency."""
    checks.one_of("frames", frames, FRAME_FORMATS)
    checks.one_of("video", video, FILM_FORMATS)
    if video == "mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ValueError("video 'mp4' needs the extra `video`: pip install 'msdwarp[video]'")
    if transparent and video not in ("webp", "none"):
        raise ValueError(f"video is {video!r}; with a transparent background it must be 'webp' or 'none'")


def write_film(
    images: Iterable[Picture],
    folder: Path,
    *,
    name: str,
    fps: float,
    frames: str = "png",
    video: str = "webp",
) -> Path | None:
    """Write pictures as they come, `frame_0000.png` and so on, and a film; return its path, if any.

    Pictures are uint8 of shape [height, width, 3] or, with opacity, [height, width, 4], all of one size; only a
    few are kept in memory. The film gets its name once it is complete. Formats: FRAME_FORMATS and FILM_FORMATS.
    """
    check_formats(frames, video)

    def piece(k: int, image: Picture, before: Picture | None) -> Any:
        if frames == "png":
            with writing(folder / f"frame_{k:04d}.png") as unfinished:
                unfinished.write_bytes(png(image))
        return _changed_part(image, before) if video == "webp" else image

    with closing(_side_by_side(images, piece)) as pieces:
        if video == "none":
            deque(pieces, maxlen=0)
            return None
        path = folder / f"{name}.{video}"
        with writing(path) as unfinished:
            _write_film(pieces, unfinished, video, fps)
        return path


def _side_by_side(
    images: Iterable[Picture], work: Callable[[int, Picture, Picture | None], Any]
) -> Generator[Any]:
    """Yield what `work(index, picture, previous one)` returns, in order; there is a thread for each core."""
    workers, before = min(MOST_WRITERS, cores()), None
    pending: deque[Future[Any]] = deque()
    with ThreadPoolExecutor(workers) as pool:  # works on all finished pictures, even if drawing fails
        for k, image in enumerate(images):
            while len(pending) > workers:
                yield pending.popleft().result()
            pending.append(pool.submit(work, k, image, before))
            before = image
        for each in pending:
            yield each.result()


def png(image: Picture) -> bytes:
    """Return a picture, uint8 of shape [height, width, 3 or 4], as a PNG file (ISO/IEC 15948).

    Every row is stored as its differences from the one above. Intel's ISA-L compresses them in a quarter of zlib's
    time, into files of about the same size. Pillow, which tries five filters for each row, takes ten times that.
    """
    height, width, channels = image.shape
    rows = np.ascontiguousarray(image).reshape(height, channels * width)
    filtered = np.full(
        (height, channels * width + 1), 2, dtype=np.uint8
    )  # each row begins with its filter: 2 is "up"
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)  # 8 bits each
    body = zlib.compress(filtered.data, level=1)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def _write_film(pieces: Iterator[Any], path: Path, video: str, fps: float) -> None:
    """Write a film of pictures, or a WebP of their `_changed_part`."""
    if video == "webp":
        _write_webp(pieces, path, fps)
    elif video == "mp4":
        import imageio.v2 as imageio  # pyright: ignore[reportMissingImports]

        writer: Any = imageio.get_writer(path, fps=fps, macro_block_size=2, quality=8)
        with writer as film:
            for image in pieces:
                film.append_data(image)
    else:
        # GIF stores whole hundredths of a second, and viewers slow down delays below 2.
        every = math.ceil(fps * 0.02)
        shown = map(Image.fromarray, itertools.islice(pieces, 0, None, every))
        next(shown).save(path, save_all=True, append_images=shown, duration=1000 * every / fps, loop=0)
        deque(pieces, maxlen=0)  # consume the pictures after the last one shown


def _changed_part(image: Picture, before: Picture | None) -> tuple[bytes, bytes]:
    """Return the position of the smallest part of a picture that has all changes, and this part as WebP.

    Pillow's own films compare whole pictures, in one thread, and take 1.7 times as long.
    """
    top, left, (rows, columns, channels) = 0, 0, image.shape
    if before is not None:
        differs = image.reshape(rows, -1) != before.reshape(rows, -1)
        row, column = (np.flatnonzero(differs.any(axis=axis)) // n for axis, n in ((1, 1), (0, channels)))
        ends = [
            (max(part[0] - SMEARED, 0) // 2 * 2, part[-1] + 1 + SMEARED) if len(part) else (0, 2)
            for part in (row, column)
        ]
        (top, bottom), (left, right) = ends  # the format's first row and column are even
        rows, columns = min(bottom, rows) - top, min(right, columns) - left
    encoded = io.BytesIO()
    part = Image.fromarray(image[top : top + rows, left : left + columns])
    part.save(encoded, "WEBP", quality=75, method=2)  # the default method takes twice as long for 5 % fewer bytes
    place = (left // 2, top // 2, columns - 1, rows - 1)
    data = encoded.getvalue()[12:]
    data = data[18:] if data.startswith(b"VP8X") else data  # a header of files with opacity, which films have once
    return b"".join(_in_24_bits(n) for n in place), data


def _write_webp(parts: Iterator[tuple[bytes, bytes]], path: Path, fps: float) -> None:
    """Write a film from the parts of pictures that change (RFC 9649)."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return kind + struct.pack("<I", len(data)) + data + bytes(len(data) % 2)

    opacity = False
    with path.open("wb") as file:
        for k, (place, encoded) in enumerate(parts):
            opacity = opacity or encoded.startswith(b"ALPH")
            if k == 0:  # it is the whole picture, whose size is that of the film
                file.write(b"RIFF    WEBP" + chunk(b"VP8X", b"\2\0\0\0" + place[6:]) + chunk(b"ANIM", bytes(6)))
            milliseconds = round(1000 * (k + 1) / fps) - round(1000 * k / fps)
            file.write(chunk(b"ANMF", place + _in_24_bits(milliseconds) + b"\2" + encoded))  # 2: replace the part
        size = file.tell() - 8
        file.seek(4)
        file.write(struct.pack("<I", size))
        file.seek(20)
        file.write(b"\x12" if opacity else b"\2")  # what the file has: an animation, and opacity


def _in_24_bits(number: int) -> bytes:
    return int(number).to_bytes(3, "little")
