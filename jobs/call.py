"""Call process: makes the call that a file of a folder holds, and leaves its value there."""

from __future__ import annotations

import json
import pickle
import signal
import sys
from pathlib import Path
from types import FrameType

from gsfw.core.errors import UserError


def main(folder: Path) -> int:
    """Make the call; an error for the user is printed as a command with json=true prints it."""
    # Otherwise it would end at once, and leave processes and temporary files of the call.
    signal.signal(signal.SIGTERM, _leave)
    function, arguments = pickle.loads((folder / "call").read_bytes())
    try:
        value = function(*arguments)
    except UserError as error:
        sys.stdout.write(json.dumps({"error": error.message, "advice": error.advice}))
        return error.exit_code
    (folder / "value").write_bytes(pickle.dumps(value))
    return 0


def _leave(number: int, frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
