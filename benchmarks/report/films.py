"""The films of the gallery: each scene as `msdwarp run` shows it, small.

    python -m benchmarks.report.films [--scenes NAME ...] [--resolution WIDTHxHEIGHT]

writes docs/films/NAME.mp4; `--scenes cube worm` makes those only. It needs `pip install 'msdwarp[video]'`.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from ..common import IMAGES, scene_scripts

FILMS = IMAGES.parent / "films"


def make(name: str, resolution: str) -> Path:
    """Simulate a scene on the CPU and film it; return the film."""
    import imageio_ffmpeg  # pyright: ignore[reportMissingImports]

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / name
        how = ["--device", "cpu", "--frames", "none", "--video", "mp4", "--resolution", resolution, "--quiet"]
        subprocess.run([sys.executable, "-m", "msdwarp", "run", name, "--out", out, *how], check=True)
        (film,) = out.glob("*.mp4")
        FILMS.mkdir(exist_ok=True)
        small = FILMS / f"{name}.mp4"
        # A third of the size; the index first, so that a browser plays before all of it is there.
        finish = ["-crf", "25", "-preset", "slow", "-movflags", "+faststart", "-loglevel", "error", "-y"]
        subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-i", film, *finish, small], check=True)
        return small


def main() -> None:
    """Make the films that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    scripts = scene_scripts()
    parser.add_argument("--scenes", nargs="+", choices=scripts, default=list(scripts), help="by default all")
    parser.add_argument("--resolution", default="640x400")
    options = parser.parse_args()
    for name in options.scenes:
        film = make(name, options.resolution)
        print(f"{film}: {film.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
