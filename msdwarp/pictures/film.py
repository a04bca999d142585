"""Films and frames on disk."""

import importlib.util
import math
import os
import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from queue import Full, Queue
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import checks
from ..disk import replacing

try:
    from isal import isal_zlib as zlib
except ImportError:  # there is none for this processor: slower, the same pictures
    import zlib

MOST_WRITERS, WAITING = 8, 3
"""Threads that write frames, at most, and pictures that wait for the film: so much memory and no more."""
FRAME_FORMATS = ("png", "none")
FILM_FORMATS = ("webp", "mp4", "gif", "none")


def check_formats(frames: str, video: str) -> None:
    """Raise ValueError unless both formats are known, and mp4 can be written if it is asked for."""
    checks.one_of("frames", frames, FRAME_FORMATS)
    checks.one_of("video", video, FILM_FORMATS)
    if video == "mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ValueError("video 'mp4' needs the extra `video`: pip install 'msdwarp[video]'")


def write_film(
    images: Iterable[NDArray[np.uint8]],
    count: int,
    folder: Path,
    *,
    name: str,
    fps: float,
    frames: str = "png",
    video: str = "webp",
) -> Path | None:
    """Write pictures as they come: `frame_0000.png` and so on, and a film.

    Parameters
    ----------
    images
        Pictures, uint8 of shape [height, width, 3], all of one size; never more than a few are kept.
    count
        How many there are.
    folder
        Where to, an existing folder.
    name
        Name of the film, without its ending.
    fps
        Pictures per second of the film.
    frames, video
        Formats, see FRAME_FORMATS and FILM_FORMATS.

    Returns
    -------
    Path | None
        The film, if one was asked for. It has its name only once it is whole.
    """
    check_formats(frames, video)
    if video == "none":
        with _FrameWriter(folder, frames) as keep:
            for image in images:
                keep(image)
        return None
    path = folder / f"{name}.{video}"
    with (
        replacing(path) as unfinished,
        _FrameWriter(folder, frames) as keep,
        _InThread(lambda passed_on: _write_film(passed_on, count, unfinished, video, fps)) as film,
    ):
        for image in images:
            keep(image)
            film(image)
    return path


class _FrameWriter:
    """Writes pictures as PNG in threads, as many at a time as there are processors."""

    def __init__(self, folder: Path, frames: str) -> None:
        self._folder, self._frames, self._count = folder, frames, 0
        self._workers = max(1, min(MOST_WRITERS, processors()))
        self._pending: deque[Future[int]] = deque()

    def __enter__(self) -> Callable[[NDArray[np.uint8]], None]:
        self._pool = ThreadPoolExecutor(self._workers)
        return self._keep

    def _keep(self, image: NDArray[np.uint8]) -> None:
        if self._frames == "none":
            return
        while len(self._pending) > self._workers:
            self._pending.popleft().result()
        path = self._folder / f"frame_{self._count:04d}.png"
        self._count += 1
        self._pending.append(self._pool.submit(lambda: path.write_bytes(png(image))))

    def __exit__(self, kind: Any, error: Any, traceback: Any) -> None:
        self._pool.shutdown()  # what was drawn is kept, also where drawing fails
        if kind is None:
            for each in self._pending:
                each.result()


class _InThread:
    """Has a thread take pictures one after another while the next are made; a few wait at most.

    What goes wrong in the thread is raised when the next picture is handed over, or at the end.
    """

    def __init__(self, take: Callable[[Iterator[NDArray[np.uint8]]], None]) -> None:
        self._take, self._ended = take, False
        self._waiting: Queue[NDArray[np.uint8] | None] = Queue(WAITING)

    def __enter__(self) -> Callable[[NDArray[np.uint8]], None]:
        self._pool = ThreadPoolExecutor(1)
        self._done = self._pool.submit(self._run)
        return self._hand_over

    def _run(self) -> None:
        try:
            self._take(self._pictures())
        finally:
            self._ended = True

    def _pictures(self) -> Iterator[NDArray[np.uint8]]:
        while (image := self._waiting.get()) is not None:
            yield image

    def _hand_over(self, image: NDArray[np.uint8] | None) -> None:
        while not self._ended:
            try:
                self._waiting.put(image, timeout=0.1)
            except Full:
                continue
            return
        if image is not None:
            self._done.result()

    def __exit__(self, kind: Any, error: Any, traceback: Any) -> None:
        self._hand_over(None)  # the end, also of a film that was broken off
        self._pool.shutdown()
        if kind is None:
            self._done.result()


def png(image: NDArray[np.uint8]) -> bytes:
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


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Reel(Image.Image):
    """The pictures as one image of many frames, in Pillow's sense: each is fetched when it is sought.

    As `append_images` they would all be in memory at once: Pillow makes a list of those for WebP.
    """

    def __init__(self, images: Iterator[NDArray[np.uint8]], count: int) -> None:
        super().__init__()
        self.n_frames = count
        self._images, self._at = images, -1
        self.seek(0)

    def seek(self, frame: int) -> None:
        """Go forward to a frame; going back shows the present one."""
        if frame >= self.n_frames:
            raise EOFError
        while self._at < frame:
            picture = Image.fromarray(next(self._images))
            # A class of images has to set `_mode` and `_size` itself: `mode` and `size` can only be read (Pillow
            # Handbook, "Writing your own image plugin").
            self.im, self._mode, self._size = picture.im, picture.mode, picture.size
            self._at += 1

    def tell(self) -> int:
        """Return the number of the present frame."""
        return self._at


def _write_film(images: Iterator[NDArray[np.uint8]], count: int, path: Path, video: str, fps: float) -> None:
    if video == "mp4":
        import imageio.v2 as imageio  # pyright: ignore[reportMissingImports]

        writer: Any = imageio.get_writer(path, fps=fps, macro_block_size=2, quality=8)
        with writer as film:
            for image in images:
                film.append_data(image)
        return
    every = 1
    if video == "gif":  # counts whole hundredths of a second, and viewers slow down anything below 2
        every = math.ceil(fps * 0.02)
        images = (image for k, image in enumerate(images) if k % every == 0)
    reel = _Reel(images, math.ceil(count / every))
    # Method 2: half the time of the default method at 6 % more bytes. Key frames are compressed twice, and Pillow
    # would write them at every fifth picture at least. Without any, specks stay where something has passed.
    options: dict[str, Any] = {"quality": 75, "method": 2, "kmin": 29, "kmax": 30} if video == "webp" else {}
    reel.save(path, save_all=True, duration=1000 * every / fps, loop=0, **options)
    for _ in images:  # those behind the last one shown
        pass
