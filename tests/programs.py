"""Python programs in processes of their own, and code that a file may hide."""

import os
import subprocess
import sys
from pathlib import Path


class Bomb:
    """Leaves a mark where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self.mark,)


HANG_S = 1200
"""A program that has not ended by then hangs; the longest needs a tenth of it on a busy machine."""


def python(
    *words: object, cwd: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run the interpreter with these words; ``environment`` is added to that of this process."""
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=cwd,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_S,
    )
