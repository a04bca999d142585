"""Films and frames on disk."""

import importlib.util
import itertools
import math
import struct
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from queue import Full, Queue
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import checks
from ..disk import replacing
from ..runtime import cores

try:
    from isal import isal_zlib as zlib
except ImportError:  # there is none for this processor: slower, the same pictures
    import zlib

MOST_WRITERS, WAITING = 8, 3
"""Maximal number of threads that write frames, and of pictures that wait for the film: limits of memory."""
FRAME_FORMATS = ("png", "none")
FILM_FORMATS = ("webp", "mp4", "gif", "none")
Picture = NDArray[np.uint8]


def check_formats(frames: str, video: str) -> None:
    """Raise ValueError unless both formats are known, and mp4 can be written if it is requested."""
    checks.one_of("frames", frames, FRAME_FORMATS)
    checks.one_of("video", video, FILM_FORMATS)
    if video == "mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ValueError("video 'mp4' needs the extra `video`: pip install 'msdwarp[video]'")


def write_film(
    images: Iterable[Picture],
    count: int,
    folder: Path,
    *,
    name: str,
    fps: float,
    frames: str = "png",
    video: str = "webp",
) -> Path | None:
    """Write `count` pictures as they come, `frame_0000.png` and so on, and a film; return its path, if any.

    Pictures are uint8 of shape [height, width, 3], all of one size; only a few are kept in memory. The film gets
    its name once it is complete. Formats: FRAME_FORMATS and FILM_FORMATS.
    """
    check_formats(frames, video)
    with closing(_written(images, folder if frames == "png" else None)) as pictures:
        if video == "none":
            deque(pictures, maxlen=0)
            return None
        path = folder / f"{name}.{video}"
        with replacing(path) as unfinished:
            _in_thread(pictures, lambda passed_on: _write_film(passed_on, count, unfinished, video, fps))
        return path


def _written(images: Iterable[Picture], folder: Path | None) -> Generator[Picture]:
    """Pass pictures on, and write them as PNG in threads, as many at a time as there are cores."""
    workers = min(MOST_WRITERS, cores())
    pending: deque[Future[int]] = deque()
    with ThreadPoolExecutor(workers) as pool:  # writes all finished pictures, even if drawing fails
        for k, image in enumerate(images):
            if folder is not None:
                while len(pending) > workers:
                    pending.popleft().result()
                path = folder / f"frame_{k:04d}.png"
                pending.append(pool.submit(lambda path, image: path.write_bytes(png(image)), path, image))
            yield image
        for each in pending:
            each.result()


def _in_thread(images: Iterable[Picture], take: Callable[[Iterator[Picture]], None]) -> None:
    """Pass pictures one by one to a thread while the next ones are drawn; at most a few wait.

    An error of the thread is raised at the next picture, or at the end.
    """
    waiting: Queue[Picture | None] = Queue(WAITING)

    def pictures() -> Iterator[Picture]:
        while (image := waiting.get()) is not None:
            yield image

    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(take, pictures())

        def hand_over(image: Picture | None) -> None:
            while not done.done():
                try:
                    return waiting.put(image, timeout=0.1)
                except Full:
                    pass

        try:
            for image in images:
                hand_over(image)
                if done.done():
                    break
        finally:
            hand_over(None)  # marks the end, also of an interrupted film
        done.result()


def png(image: Picture) -> bytes:
    """Return a picture, uint8 of shape [height, width, 3], as a PNG file (ISO/IEC 15948).

    Every row is stored as its differences from the one above. Intel's ISA-L compresses them in a quarter of zlib's
    time, into files of about the same size. Pillow, which tries five filters for each row, takes ten times that.
    """
    height, width, _ = image.shape
    rows = np.ascontiguousarray(image).reshape(height, 3 * width)
    filtered = np.full((height, 3 * width + 1), 2, dtype=np.uint8)  # each row begins with its filter: 2 is "up"
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)  # 8 bits of red, green and blue each
    body = zlib.compress(filtered.data, level=1)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


class _Reel(Image.Image):
    """The pictures as a Pillow image of many frames, each made when Pillow seeks it.

    As `append_images` all pictures would be in memory at once, because Pillow makes a list of them for WebP.
    """

    def __init__(self, images: Iterator[Picture], count: int) -> None:
        super().__init__()
        self.n_frames = count
        self._images, self._at = images, -1
        self.seek(0)

    def seek(self, frame: int) -> None:
        """Go forward to a frame; going back keeps the current one."""
        if frame >= self.n_frames:
            raise EOFError
        while self._at < frame:
            picture = Image.fromarray(next(self._images))
            # Subclasses set `_mode` and `_size`, as `mode` and `size` are read-only (Pillow Handbook, "Writing
            # your own image plugin").
            self.im, self._mode, self._size = picture.im, picture.mode, picture.size
            self._at += 1

    def tell(self) -> int:
        """Return the index of the current frame."""
        return self._at


def _write_film(images: Iterator[Picture], count: int, path: Path, video: str, fps: float) -> None:
    if video == "mp4":
        import imageio.v2 as imageio  # pyright: ignore[reportMissingImports]

        writer: Any = imageio.get_writer(path, fps=fps, macro_block_size=2, quality=8)
        with writer as film:
            for image in images:
                film.append_data(image)
        return
    # GIF stores whole hundredths of a second, and viewers slow down delays below 2.
    every = math.ceil(fps * 0.02) if video == "gif" else 1
    reel = _Reel(itertools.islice(images, 0, None, every), math.ceil(count / every))
    # Method 2: half the time of the default method at 6 % more bytes. Key frames are compressed twice, and Pillow
    # would write them at every fifth picture at least. Without any, specks stay where something has passed.
    options: dict[str, Any] = {"quality": 75, "method": 2, "kmin": 29, "kmax": 30} if video == "webp" else {}
    reel.save(path, save_all=True, duration=1000 * every / fps, loop=0, **options)
    deque(images, maxlen=0)  # consume the pictures after the last one shown
