"""Kill -9 builds of several tiles: what is published is whole, and the next run goes on.

Three series; after every kill the scene is opened and every hash, bound and payload checked, the
same command is given again, and the bytes that it publishes at last are compared with those of an
undisturbed run.

first   The first build of a scene, killed at random moments, and given again until it ends. There
        is no scene, or the whole one; tiles that were finished are not done again.
next    A build of the next survey over a scene, in the same way. The old scene stands, or the new
        one does.
exact   The same, killed before acts that have to do with publishing: renames, links, deletions and
        files opened in the scene and in what the work directory keeps for the survey after. Around
        the rename that publishes that survey is built, too: after the same command, and without it.

    python benchmarks/kill_build.py            20 + 10 + 24 kills, about 20 minutes
    python benchmarks/kill_build.py --series exact
    python benchmarks/kill_build.py --smoke    2 kills, about a minute
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from parts.hill_surveys import BUILD_OPTIONS, write_hill
from parts.killed_command import (
    check_scene,
    finished_tiles,
    results,
    run,
    run_killed,
    run_recorded,
    scene_bytes,
)

PUBLISH: Final = "os.rename"

_RESULTS: Final = 40
_MOST_S: Final = 1.5
"""A run is killed after it has finished some more results of tiles, fewer than this, and so many
seconds more at most: moments that do not depend on how fast a machine is."""


@dataclass
class Place:
    """Surveys, one scene and its work directory, with copies of both to begin from."""

    folder: Path
    broken: list[str] = field(default_factory=list)
    """What was not as it should be."""

    @property
    def scene(self) -> Path:
        """What is built."""
        return self.folder / "hill"

    @property
    def work(self) -> Path:
        """Its work directory."""
        return self.folder / ".hill.work"

    def survey(self, flight: int) -> Path:
        """Name the file of a flight."""
        return self.folder / f"flight-{flight}.xyz"

    def build(self, flight: int) -> list[str]:
        """Give the command that builds a flight's survey over what is there."""
        return ["build", str(self.survey(flight)), "-o", str(self.scene), *BUILD_OPTIONS]

    def finished(self, given: dict[str, int], count: int) -> Callable[[], bool]:
        """Make what says whether so many results of tiles are finished beside those given."""

        def is_so() -> bool:
            times = finished_tiles(self.work)
            return sum(given.get(name) != time for name, time in times.items()) >= count

        return is_so

    def keep(self, name: str) -> None:
        """Keep scene and work directory as they are."""
        shutil.rmtree(self.folder / name, ignore_errors=True)
        for path in (self.scene, self.work):
            if path.exists():
                shutil.copytree(path, self.folder / name / path.name, copy_function=shutil.copy2)

    def begin_from(self, name: str | None) -> None:
        """Put back what was kept; None: nothing."""
        for path in (self.scene, self.work):
            shutil.rmtree(path, ignore_errors=True)
            kept = self.folder / (name or "") / path.name
            if name is not None and kept.exists():
                shutil.copytree(kept, path, copy_function=shutil.copy2)

    def expect(self, what: bool, text: str) -> str:
        """Note what was expected and is not so; return what to print."""
        if not what:
            self.broken.append(text)
        return "" if what else f"; BROKEN: {text}"

    def whole(self, versions: Sequence[str | None]) -> tuple[str | None, str]:
        """Check what is published after a kill: one of the versions, and whole."""
        version, findings = check_scene(self.scene)
        said = self.expect(version in versions, f"version {version} is published")
        return version, said + self.expect(not findings, f"the scene is damaged: {findings[:3]}")


def kill_at_random(
    place: Place, title: str, flight: int, start: str | None, kills: int, rng: np.random.Generator
) -> None:
    """Kill a build again and again at random moments until it has ended; begin anew; compare."""
    # (1) Undisturbed.
    place.begin_from(start)
    old, _ = check_scene(place.scene)
    place.begin_from(f"flight {flight}")
    new, _ = check_scene(place.scene)
    expected = scene_bytes(place.scene)
    killed = 0
    while killed < kills:
        place.begin_from(start)
        given, own = finished_tiles(place.work), dict[str, int]()
        # Invariant: `own` are the results of tiles that killed runs of this build have finished.
        was_running = True
        while was_running and killed < kills:
            # (2) Killed: the old scene or the new one is there, whole.
            wanted, moment_s = (
                len(own) + int(rng.integers(_RESULTS)),
                float(rng.uniform(0, _MOST_S)),
            )
            was_running = run_killed(
                place.build(flight), reached=place.finished(given, wanted), after_s=moment_s
            )
            version, said = place.whole((old, new))
            # (3) A tile that an earlier run had finished was not done again.
            left = finished_tiles(place.work)
            again = sum(left.get(name) != time for name, time in own.items())
            said += place.expect(again == 0, f"{again} finished results were computed again")
            more = sum(name not in own and given.get(name) != left[name] for name in left)
            own = {name: time for name, time in left.items() if given.get(name) != time}
            state = "no" if version is None else "old" if version == old else "new"
            killed += was_running
            verb = f"kill {killed}" if was_running else "ended"
            print(
                f"{title}: {verb}, {state} scene, {more} more results of "
                f"tiles, {again} of {len(own) - more} a second time{said}",
                flush=True,
            )
        # (4) To the end.
        run(place.build(flight))
        after = finished_tiles(place.work)
        again = sum(after.get(name) != time for name, time in own.items())
        said = place.expect(again == 0, f"{again} finished results were computed again")
        said += place.expect(scene_bytes(place.scene) == expected, "other bytes")
        print(
            f"{title}: to the end, {len(after) - len(own)} more, {again} of {len(own)} a second "
            f"time, the same bytes{said}",
            flush=True,
        )


def kill_exactly(
    place: Place,
    flight: int,
    start: str,
    paths: str,
    *,
    until_turned: bool,
    share: slice,
) -> int:
    """Kill the build of a flight before acts on paths; go on with it, and with the flight after.

    Returns
    -------
    int
        Kills.
    """
    # (1) Undisturbed: the acts, the bytes, and what is kept for the flight after.
    place.begin_from(start)
    old, _ = check_scene(place.scene)
    acts = run_recorded(place.build(flight), paths, place.folder / "acts.json")
    new, _ = check_scene(place.scene)
    expected, remembered = scene_bytes(place.scene), results(place.work / "published")
    run(place.build(flight + 1))
    expected_next = scene_bytes(place.scene)
    renames = [number for number, act in enumerate(acts) if act[0] == PUBLISH]
    published = next((n for n in renames if acts[n][2] == str(place.scene / "scene.json")), -1)
    until = renames[0] + 1 if until_turned else len(acts)
    chosen = _few(acts, until, renames)[share]
    for act in chosen:
        # (2) Killed: the new scene is there if it was published, else the old one; whole.
        event, *names = acts[act]
        place.begin_from(start)
        killed = run_killed(place.build(flight), paths=paths, before_act=act)
        is_new = -1 < published < act
        _, said = place.whole((new if is_new else old,))
        said += place.expect(killed, "the act did not come")
        place.keep("killed")
        # (3) The same command; then, around publishing, the flight after.
        run(place.build(flight))
        said += place.expect(scene_bytes(place.scene) == expected, "other bytes")
        kept = results(place.work / "published") == remembered
        said += place.expect(kept, "other results are kept for the flight after")
        follows = act in renames or act == published + 1
        if follows:
            run(place.build(flight + 1))
            same = scene_bytes(place.scene) == expected_next
            said += place.expect(same, "the flight after: other bytes")
        # (4) The flight after at once, over the new scene.
        if follows and is_new:
            place.begin_from("killed")
            run(place.build(flight + 1))
            same = scene_bytes(place.scene) == expected_next
            said += place.expect(same, "the flight after at once: other bytes")
        shown = " to ".join(Path(name).relative_to(place.folder).as_posix() for name in names)
        state = f"{'new' if is_new else 'old'} scene{', and the flight after' * follows}"
        print(
            f"exact: killed before act {act + 1} of {len(acts)}, {event.rpartition('.')[2]} "
            f"{shown}: {state}{said}",
            flush=True,
        )
    return len(chosen)


def exact_series(place: Place, *, share: slice) -> int:
    """Kill before the acts of turning results over, then before those of publishing."""
    scene, work = str(place.scene), str(place.work)
    # (1) At the start what was published becomes what was before: over a scene that has both.
    kills = 0
    paths = f"^{work}/(before|published)"
    if not share.start:
        kills = kill_exactly(place, 2, "flight 1", paths, until_turned=True, share=slice(None))
    # (2) The end, from where all tiles are finished.
    if not (place.folder / "to publish").exists():
        place.begin_from("flight 0")
        run_killed(place.build(1), paths=f"^{scene}/", before_act=0)
        place.keep("to publish")
    paths = f"^({scene}/|{work}/(pack$|\\.pack\\.|published|\\.published|next|\\.next))"
    return kills + kill_exactly(place, 1, "to publish", paths, until_turned=False, share=share)


def _few(acts: Sequence[list[str]], until: int, renames: Sequence[int]) -> list[int]:
    """Every rename and the act after it; of other acts the first of each run of its kind."""
    links = ("os.link", "os.mkdir")
    return [
        number
        for number in range(until)
        if number in renames
        or number - 1 in renames
        or number == 0
        or (acts[number][0] != acts[number - 1][0] and acts[number - 1][0] not in links)
    ]


def undisturbed(place: Place, *, flights: int) -> None:
    """Build flights over one another, and keep each with the seconds that it took."""
    seconds: list[float] = []
    for flight in range(flights):
        noted = place.folder / f"flight {flight}" / "seconds"
        if not noted.exists():
            write_hill(place.survey(flight), flight)
            place.begin_from(f"flight {flight - 1}" if flight else None)
            took_s = run(place.build(flight))
            stages = json.loads((place.scene / "build.json").read_bytes())["stages"]
            renewed = [stage["counts"] for stage in stages if stage["name"] == "renew"]
            if flight and not renewed[0]["changed_blocks"]:
                raise SystemExit(f"flight {flight} changes nothing; expected work for some tiles")
            place.keep(f"flight {flight}")
            noted.write_text(str(took_s), encoding="ascii")
        seconds.append(float(noted.read_text(encoding="ascii")))
    for flight in range(flights, 4):
        write_hill(place.survey(flight), flight)
    tiles = len(list((place.folder / "flight 0" / place.work.name).glob("solve-*")))
    print(f"{tiles} tiles; {', then '.join(f'{took_s:.1f}' for took_s in seconds)} s", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    every = ("first", "next", "exact")
    parser.add_argument("--series", choices=every, nargs="+", default=every)
    parser.add_argument("--rounds", type=int, default=20, help="kills of first builds")
    parser.add_argument("--next-rounds", type=int, default=10, help="kills of builds over a scene")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--acts", type=int, nargs=2, default=(0, None), help="first and end of those killed before"
    )
    parser.add_argument("--keep", type=Path, help="folder of undisturbed builds, taken up again")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    series = ("first",) if arguments.smoke else arguments.series
    rounds, next_rounds = (2, 0) if arguments.smoke else (arguments.rounds, arguments.next_rounds)
    rng = np.random.default_rng(arguments.seed)
    folder = arguments.keep or Path(tempfile.mkdtemp(prefix="kill-build-"))
    folder.mkdir(parents=True, exist_ok=True)
    place = Place(folder)
    kills = 0
    try:
        undisturbed(place, flights=1 if arguments.smoke else 2)
        if "first" in series:
            kill_at_random(place, "first", 0, None, rounds, rng)
            kills += rounds
        if "next" in series:
            kill_at_random(place, "next", 1, "flight 0", next_rounds, rng)
            kills += next_rounds
        if "exact" in series:
            kills += exact_series(place, share=slice(*arguments.acts))
        left = [p.name for p in (*place.scene.iterdir(), *place.work.glob(".*.tmp"))]
        left = [name for name in left if name.endswith(".tmp")]
        place.expect(not left, f"left behind: {left}")
        print(f"{kills} kills, {len(place.broken)} not as they should be: {place.broken or 'none'}")
    finally:
        if arguments.keep is None:
            shutil.rmtree(place.folder, ignore_errors=True)
    return 1 if place.broken else 0


if __name__ == "__main__":
    sys.exit(main())
