"""A process that replaces a result again and again, and is killed on the way.

``python killed.py OUT`` goes on until somebody kills it; ``python killed.py OUT exchange|rename``
has a child killed at every step on files that replacing takes, one after the other, and prints how
many steps there were and after how many there was no result at OUT. Result n has files that hold
its number, of which one is in results of odd number only.
"""

from __future__ import annotations

import errno
import json
import os
import signal
import sys
from pathlib import Path

from designopt.io import staging
from designopt.study.result_folders import recover_result, result_folder, write_document

STEPS = ("open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.listdir", "os.scandir")


def write(out: Path, number: int) -> None:
    with result_folder(out, force=True) as folder:
        for name in ("tables", "figures"):
            (folder / name).mkdir()
        (folder / "tables" / "a.csv").write_text(f"{number}\n" * 100)
        (folder / "figures" / "a.svg").write_text(f"{number}\n")
        if number % 2:
            (folder / "figures" / "odd.svg").write_text(f"{number}\n")
        write_document(folder, {"study": "killed", "spec": {}, "metrics": {}, "number": number})


def number_of(out: Path) -> int:
    """The number of a result; an `AssertionError` if it is not whole."""
    document = json.loads((out / "results.json").read_text())
    number = document["number"]
    names = {"tables/a.csv", "figures/a.svg"} | ({"figures/odd.svg"} if number % 2 else set())
    files = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()}
    assert files == names | {"results.json"}
    assert {each["path"] for each in document["manifest"]} == names
    for name in names:
        assert set((out / name).read_text().split()) == {str(number)}
    return number


def refuse_exchange(*_: Path) -> None:
    raise OSError(errno.ENOSYS, "no exchange here")


def replace_and_be_killed(out: Path, step: int) -> None:
    """Replace a result once, unless that takes so many steps."""
    left, number = step, number_of(out) + 1

    def count(event: str, _: object) -> None:
        nonlocal left
        if event in STEPS:
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(count)
    write(out, number)


def every_step(out: Path) -> tuple[int, int]:
    """Steps of a replacement, and those after which a kill left no result.

    After each kill the next replacement must find a whole result, and leave nothing beside it.
    """
    number = step = missing = 0
    write(out, number)
    while True:
        step += 1
        child = os.fork()
        if child == 0:
            replace_and_be_killed(out, step)
            os._exit(0)
        if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0:
            return step, missing
        if out.exists():
            assert number_of(out) in (number, number + 1), step
        else:
            missing += 1
        recover_result(out)
        assert number_of(out) in (number, number + 1), step
        number += 2
        write(out, number)
        assert number_of(out) == number
        assert [path.name for path in out.parent.iterdir()] == [out.name], step


if __name__ == "__main__":
    place = Path(sys.argv[1])
    if len(sys.argv) > 2:
        if sys.argv[2] == "rename":
            staging._exchange = refuse_exchange
        print(*every_step(place))
    else:
        number = number_of(place)
        while True:
            number += 1
            write(place, number)
