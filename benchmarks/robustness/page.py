"""The page of a view under attack: what it refuses, and whether the simulation goes on and stays right.

Run: python -m benchmarks.robustness.page
"""

import argparse
import http.client
import json
import os
import random
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..common import arguments, machine, read_csv, table, write_csv

ABSURD: list[Any] = [
    *(None, True, False, 0, -1, 1, 2**63, -(2**63), 0.5, 1e308, -1e308, 5e-324, float("nan"), float("inf")),
    *("", "x", "nan", "../../etc/passwd", "__class__", "\x1b[2J", "\u202e", "x" * 5000, b"", b"\xff" * 100),
    *(
        [],
        [[]],
        {},
        {"x": 1},
        [0] * 3,
        [1e308] * 3,
        [float("nan")] * 3,
        [0.0] * 4,
        [None] * 3,
        [0] * 5000,
        {"value": {}},
    ),
]
"""What a field may hold that should not."""
NAMES = (
    "value",
    "update_cb",
    "sync_cb",
    "removed",
    "is_button",
    "props",
    "uuid",
    "__class__",
    "__dict__",
    "x" * 3000,
)
"""What a client may name as attributes of a widget."""
ORIGINS = ("http://evil.example", "https://127.0.0.1", "null", "http://127.0.0.1.evil.example", "file://", "", "*")
HOSTS = ("evil.example", "127.0.0.1.evil.example", "192.0.2.1", "localhost.evil.example", "", "[::2]", "a" * 300)
PARAMETERS: list[Any] = [1500, 100_000, 2**53, -1, 0, 1, 1e30, 2.5]
"""Sizes that a scene is rebuilt with."""


class Served:
    """A view in a process of its own."""

    def __init__(self, *words: str) -> None:
        code = "from benchmarks.robustness.served import main; main()"
        command = [sys.executable, "-c", code, *words]
        root = str(Path(__file__).parents[2])
        environment = os.environ | {"MSDWARP_THREADS": "1", "PYTHONPATH": root}
        self._folder = tempfile.TemporaryDirectory()  # where buttons of the page write recordings and pictures
        self._process = subprocess.Popen(
            command,
            env=environment,
            cwd=self._folder.name,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        said = self._heard()
        self.port, self.token = int(said["port"]), said["address"].rpartition("?token=")[2]
        self.own = f"http://127.0.0.1:{self.port}"

    def _heard(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline() or "{}")

    def ask(self, word: str) -> dict[str, Any]:
        """Return what it says; nothing if it has ended."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.write(f"{word}\n")
            self._process.stdin.flush()
            return self._heard()
        return {}

    def opened(self, **other: Any) -> Any:
        """Return a web socket, opened as its own page does or otherwise."""
        import viser
        from websockets.sync.client import connect

        path, host = other.pop("path", ""), other.pop("host", f"127.0.0.1:{self.port}")
        usual: dict[str, Any] = {"origin": self.own, "max_size": None, "close_timeout": 0.5, "open_timeout": 60}
        raw = socket.create_connection(("127.0.0.1", self.port))
        name = [f"viser-v{viser.__version__}"]
        return connect(f"ws://{host}{path}", sock=raw, subprotocols=name, **(usual | other))

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()


Answer = Iterator[bool]
"""Of each thing that is sent: whether it was refused at once; of messages the page counts those that passed."""


def opening(served: Served, attempts: Iterator[dict[str, Any]]) -> Answer:
    """Try to open web sockets."""
    from websockets.exceptions import InvalidHandshake

    for one in attempts:
        try:
            served.opened(**one).close()
            yield False
        except (InvalidHandshake, ValueError, OSError, EOFError):
            yield True


def asking(served: Served, attempts: Iterator[tuple[str, dict[str, str]]]) -> Answer:
    """Send HTTP requests."""
    for path, headers in attempts:
        asked = http.client.HTTPConnection("127.0.0.1", served.port, timeout=60)
        try:
            asked.request("GET", path, headers=headers)
            yield asked.getresponse().status != 200
        except (OSError, http.client.HTTPException):
            yield True
        finally:
            asked.close()


def sending(served: Served, messages: Iterator[Any]) -> Answer:
    """Send messages on a web socket, and on another where one was hung up on."""
    import msgspec
    from websockets.exceptions import WebSocketException

    opened = served.opened()
    for one in messages:
        data = one if isinstance(one, bytes | str) else msgspec.msgpack.encode(one)
        try:
            opened.send(data)
        except (WebSocketException, OSError):
            opened = served.opened()
            opened.send(data)
        yield False
    opened.close()


def camera(served: Served) -> dict[str, Any]:
    """Return what a client says first."""
    zero, one = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    said = {"wxyz": one, "position": (3.0, 0.0, 1.0), "fov": 0.8, "near": 0.01, "far": 1e3}
    said |= {"image_height": 560, "image_width": 900, "look_at": zero, "up_direction": (0.0, 0.0, 1.0)}
    return {"type": "ViewerCameraMessage", **said}


def of_every_type(served: Served, count: int, chance: random.Random) -> Iterator[dict[str, Any]]:
    """Give messages of all types that viser has, with absurd fields."""
    from viser import _messages

    kinds = _messages.Message.get_subclasses()
    yield camera(served)
    for k in range(count):
        kind = kinds[k % len(kinds)]
        message = {one.name: chance.choice(ABSURD) for one in fields(kind)}
        if chance.random() < 0.2:
            message[chance.choice(NAMES)] = chance.choice(ABSURD)
        yield {**message, "type": kind.__name__}


def of_needed_types(served: Served, count: int, chance: random.Random) -> Iterator[dict[str, Any]]:
    """Give messages that the page needs, right but for a field."""
    uuids, zero = list(served.ask("widgets").values()), (0.0, 0.0, 0.0)
    drag = {"type": "SceneNodeDragMessage", "name": "/all/patch/0", "instance_index": None, "button": "left"}
    drag |= {"phase": "start", "start_position": zero, "start_screen_pos": (0.5, 0.5), "end_position": zero}
    drag |= {"end_screen_pos": (0.5, 0.5), "modifier": None, "owner": ""}
    yield camera(served)
    for _ in range(count):
        value = {"type": "GuiUpdateMessage", "uuid": chance.choice(uuids), "updates": {"value": 1.0}}
        message = dict(chance.choice((camera(served), drag, value)))
        field = chance.choice([name for name in message if name != "type"])
        message[field] = chance.choice(ABSURD)
        if chance.random() < 0.5:
            message["phase" if "phase" in message else "type"] = chance.choice(
                ("start", "update", "end", message["type"])
            )
        yield message


def of_attributes(served: Served, count: int, chance: random.Random) -> Iterator[dict[str, Any]]:
    """Name attributes to set of each widget."""
    uuids = [uuid for label, uuid in served.ask("widgets").items() if not label.startswith("command")]
    yield camera(served)
    for _ in range(count):
        names = chance.sample(NAMES, chance.choice((1, 1, 2)))
        updates = {name: chance.choice(ABSURD) for name in names}
        yield {"type": "GuiUpdateMessage", "uuid": chance.choice(uuids), "updates": updates}


def of_great_length(served: Served, count: int, chance: random.Random) -> Iterator[Any]:
    """Give messages that are too long or too deep, and no messages at all."""
    for k in range(count):
        deep, length = chance.choice((10, 1000, 60_000)), chance.choice((1 << 16, 1 << 20, 1 << 23))
        longest = {"type": "CommandTriggerMessage", "uuid": "x" * length}
        yield (b"\x91" * deep, chance.randbytes(length), longest, "text" * 1000, b"", b"\xc1")[k % 6]


def of_sizes(served: Served, count: int, chance: random.Random) -> Iterator[dict[str, Any]]:
    """Have the scene be rebuilt with absurd numbers."""
    widgets = served.ask("widgets")
    yield camera(served)
    for k in range(count):
        size = PARAMETERS[k % len(PARAMETERS)]
        yield {"type": "GuiUpdateMessage", "uuid": widgets["size"], "updates": {"value": size}}
        yield {"type": "GuiUpdateMessage", "uuid": widgets["rebuild"], "updates": {"value": True}}


def of_keys(served: Served, count: int, chance: random.Random) -> Iterator[dict[str, Any]]:
    """Press keys faster than they can be obeyed, but for those of other scenes."""
    keys = [
        uuid
        for label, uuid in served.ask("widgets").items()
        if label.startswith("command") and not label.startswith("command scene")
    ]
    yield camera(served)
    for _ in range(count):
        yield {"type": "CommandTriggerMessage", "uuid": chance.choice(keys)}


def garbage(served: Served, count: int, chance: random.Random) -> Answer:
    """Connect and send what is no HTTP, or nothing."""
    kept = []
    for k in range(count):
        with suppress(OSError):
            raw = socket.create_connection(("127.0.0.1", served.port))
            if k % 2:
                raw.sendall(chance.randbytes(5000))
            kept.append(raw)
        yield True
    for raw in kept:
        raw.close()


def campaign(scale: int, seed: int, minutes: float) -> list[dict]:
    """Attack two views, one with a token; return a row for each kind of attack."""
    chance, rows, end = random.Random(seed), [], time.monotonic() + 60 * minutes
    plain = Served()
    pick = chance.choice
    port = plain.port
    names = [name if name.startswith("[") else f"{name}:{port}" for name in HOSTS if name]
    attacks: list[tuple[str, int, Callable[[int], Answer]]] = [
        ("foreign origin", 10, lambda n: opening(plain, ({"origin": pick((*ORIGINS, None))} for _ in range(n)))),
        ("foreign host, web socket", 10, lambda n: opening(plain, ({"host": pick(names)} for _ in range(n)))),
        ("foreign host, HTTP", 10, lambda n: asking(plain, (("/", {"Host": pick(HOSTS)}) for _ in range(n)))),
        ("every type, absurd fields", 100, lambda n: sending(plain, of_every_type(plain, n, chance))),
        ("needed types, one absurd field", 100, lambda n: sending(plain, of_needed_types(plain, n, chance))),
        ("attributes of widgets", 100, lambda n: sending(plain, of_attributes(plain, n, chance))),
        ("too long, too deep, no message", 5, lambda n: sending(plain, of_great_length(plain, n, chance))),
        ("scenes rebuilt with absurd sizes", 1, lambda n: sending(plain, of_sizes(plain, n, chance))),
        ("keys pressed too fast", 20, lambda n: sending(plain, of_keys(plain, n, chance))),
        ("no HTTP", 5, lambda n: garbage(plain, n, chance)),
    ]
    for name, share, attack in attacks:
        rows.append(of(plain, name, attack(share * scale)))
        if time.monotonic() > end:
            break
    plain.close()
    guarded = Served("token")
    token = guarded.token
    wrong = ["", token[:-1], token + "x", token.lower(), token[::-1], "%00", "é".encode().hex()]
    paths = ({"path": f"/?token={pick(wrong)}"} for _ in range(5 * scale))
    asked = ((f"/?token={pick(wrong)}", {"Cookie": f"msdwarp={pick(wrong)}"}) for _ in range(5 * scale))
    rows.append(of(guarded, "wrong token, web socket", opening(guarded, paths)))
    rows.append(of(guarded, "wrong token, HTTP", asking(guarded, asked)))
    guarded.close()
    return rows


def of(served: Served, name: str, attack: Answer) -> dict[str, Any]:
    """Return what became of an attack."""
    began = time.monotonic()
    refused = list(attack)
    state = served.ask("state")
    passed = int(state.get("passed", 0))
    if not state or state.get("heard", 0) == 0:  # of attempts to open it
        passed = len(refused) - sum(refused)
    row: dict[str, Any] = {
        "attack": name,
        "sent": len(refused),
        "refused": len(refused) - passed,
        "passed": passed,
    }
    row |= {
        "alive": int(bool(state)),
        "stepping": int(state.get("running", False)),
        "right": int(state.get("right", False)),
    }
    row["seconds"] = time.monotonic() - began
    print(row, flush=True)
    return row


def report(line: str, rows: list[dict]) -> None:
    """Print what became of the attacks."""
    print(line)
    columns = ["attack", "sent", "refused", "passed", "alive", "stepping", "right", "seconds"]
    table("the page under attack", columns, [[row[name] for name in columns] for row in rows])
    failures = sum(not (row["alive"] and row["stepping"] and row["right"]) for row in rows)
    print(f"sent: {sum(int(row['sent']) for row in rows)}; failures: {failures} of {len(rows)} attacks")


def main() -> None:
    """Attack, print and write what became of it."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--scale", type=int, default=20, help="how many of each, in units of what --quick sends")
    own.add_argument("--seed", type=int, default=1, help="of chance")
    own.add_argument("--minutes", type=float, default=30.0, help="after which no other attack is begun")
    options = arguments(__doc__ or "", own)
    path: Path = options.folder / "page.csv"
    if options.plot_only:
        line, rows = read_csv(path)
    else:
        line, rows = machine("cpu"), campaign(1 if options.quick else options.scale, options.seed, options.minutes)
        write_csv(path, rows, line)
    report(line, rows)


if __name__ == "__main__":
    main()
