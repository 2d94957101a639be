"""Damage a session many times: `python -m tests.damage --count 2000 --first 0`; what went wrong, by kind."""

import argparse
import random
import tempfile
from collections import Counter
from pathlib import Path

from tests.damage.damages import DAMAGES, Known, check, seed_session


def main() -> int:
    """Run, print, and fail where anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="the seed of the first damage")
    options = parser.parse_args()
    done, wrong = Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        seed = seed_session(Path(folder))
        known, content = Known.of(seed), seed.read_bytes()
        for number in range(options.first, options.first + options.count):
            rng = random.Random(number)
            kind = rng.choice(list(DAMAGES))
            path = Path(folder) / f"{number}" / "a.sport"
            path.parent.mkdir()
            path.write_bytes(content)
            DAMAGES[kind](rng, path)
            problem = check(path, known)
            done[kind] += 1
            if problem:
                wrong[kind] += 1
                print(f"{number} ({kind}): {problem}", flush=True)
            for file in path.parent.iterdir():
                file.unlink()
    for kind, count in sorted(done.items()):
        print(f"{kind}: {count} damages, {wrong[kind]} wrong")
    print(f"{sum(done.values())} damages, {sum(wrong.values())} wrong")
    return int(bool(wrong))


if __name__ == "__main__":
    raise SystemExit(main())
