"""Run `sport` in this process, and have it send itself a signal at a moment: the N-th event of Python's audit of a kind.

python at_moment.py SIGNAL EVENT TEXT COUNT -- ARGUMENTS of sport
"""

import os
import signal
import sys


def send_at(number: int, event: str, text: str, count: int) -> None:
    """Send a signal when the event has come so often whose first argument holds the text."""
    left = [count]

    def watch(name: str, args: tuple[object, ...]) -> None:
        if name == event and args and text in str(args[0]):
            left[0] -= 1
            if left[0] == 0:
                os.kill(os.getpid(), number)

    sys.addaudithook(watch)


if __name__ == "__main__":  # not in the processes of a batch
    name, event, text, count = sys.argv[1:5]
    sys.argv = ["sport", *sys.argv[6:]]
    send_at(getattr(signal, name), event, text, int(count))
    from sport.cli import main

    main()
