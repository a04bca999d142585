"""Does contact obey textbook mechanics? Sliding, rolling, a rope around a bollard, Hertz, a stack, a bounce.

    python -m benchmarks.accuracy.contact_mechanics [--device D] [--quick] [--plot-only] [--only sliding stack]

Six questions, each a CSV, all at automatic substeps, in float32 but for the last:

- contact_sliding.csv: a flat die slides on a pinned slab. Its acceleration, from a line through its speeds, gives
  the friction that acts, (g sin α − a)/(g cos α): is it the friction asked for? Where Coulomb's law says that the
  die sticks, how fast does it creep? Gravity leans, not the bodies.
- contact_rolling.csv: a ball rolls down a plane or a pinned slab, at g sin α / (1 + I/(m r²))? I is that of its
  particles, r the radius that is drawn.
- contact_capstan.csv: a rope lies half around a bollard. One end is pulled more and more. At which ratio of the
  ends' tensions does the other end begin to move, and which does the rope have while it slides: exp(μ π)?
- contact_hertz.csv: a ball is pressed on a plane or a pinned slab. Is the force 4/3 E* √R d^1.5?
- contact_stack.csv: three dice lie on each other. Do contact forces carry the weights above?
- contact_bounce.csv: a block flies at a pinned one at 0.2 m/s, and lands flat, on an edge, on a corner. How fast
  does it come back, if its springs are as stiff as the contact, and ten and a hundred times as stiff?
"""

import argparse
import sys
import time

from ..common import arguments, machine, read_csv, table, write_csv
from .contact_blocks import measure_bounce, measure_sliding, measure_stack
from .contact_mechanics_plots import draw_bounce, draw_round, draw_sliding
from .contact_round import measure_capstan, measure_hertz, measure_rolling

PARTS = {
    "sliding": measure_sliding,
    "rolling": measure_rolling,
    "capstan": measure_capstan,
    "hertz": measure_hertz,
    "stack": measure_stack,
    "bounce": measure_bounce,
}
ROUND = ("rolling", "capstan", "hertz")
"""Parts that share a chart."""
UNSHOWN = ("substeps", "coulomb", "mean_speed", "contact_radius", "touch")
"""Columns that are written, and not printed."""


def main() -> None:
    """Measure, write, print and draw."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS), help="these parts only")
    options = arguments(__doc__.splitlines()[0], own)
    paths = {part: options.folder / f"contact_{part}.csv" for part in PARTS}
    for part in options.only:
        if not options.plot_only:
            begun = time.perf_counter()
            write_csv(paths[part], PARTS[part](options), machine(options.device))
            print(f"{paths[part].name}: {time.perf_counter() - begun:.0f} s", flush=True)
        _, rows = read_csv(paths[part])
        shown = [name for name in rows[0] if name not in UNSHOWN]
        table(paths[part].name, shown, [[row[name] for name in shown] for row in rows])
    if options.quick:
        return
    if "sliding" in options.only:
        draw_sliding(read_csv(paths["sliding"])[1])
    if "bounce" in options.only:
        draw_bounce(read_csv(paths["bounce"])[1])
    if set(ROUND) & set(options.only) and all(paths[part].exists() for part in ROUND):
        draw_round(*(read_csv(paths[part])[1] for part in ROUND))


if __name__ == "__main__":
    sys.exit(main())
