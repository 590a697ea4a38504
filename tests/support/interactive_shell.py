"""InteractiveShell: a shell on a terminal of its own, whose Tab key a test can press."""

from __future__ import annotations

import os
import pty
import select
import signal
import time
from pathlib import Path

WAIT = 60.0
"""Longest answer of a shell, in seconds; a busy machine needs some."""

ARGUMENTS = {
    "bash": ["--norc", "--noprofile", "-i"],
    "zsh": ["-f", "-i"],
    "fish": ["--no-config", "-i"],
}
"""Without the user's own files."""

SETUP = {
    "bash": r"""bind 'set bell-style none'; bind 'set enable-bracketed-paste off'
bind -x '"\C-x\C-l": printf %s "$READLINE_LINE" > line.new; mv line.new line'
""",
    "zsh": r"""zmodload zsh/complist; autoload -U compinit; compinit -D -u
_line() { print -rn -- "$BUFFER" > line.new; mv line.new line }
zle -N _line; bindkey -e; bindkey '^X^L' _line; unsetopt beep
zstyle ':completion:*' list-prompt ''
""",
    "fish": r"""function fish_prompt; echo '> '; end
bind \cx\cl 'commandline > line.new; mv line.new line'
""",
}
"""Ctrl-X Ctrl-L writes the command line into the file ``line``; a terminal that is not yet in the
hands of the shell passes these keys on."""


class InteractiveShell:
    """bash, zsh or fish with the completion of gsfw, in a folder."""

    def __init__(self, name: str, script: Path, folder: Path) -> None:
        self._folder = folder
        self._process, self._terminal = pty.fork()
        if self._process == 0:
            os.chdir(folder)
            os.environ |= {"TERM": "xterm", "PS1": "> ", "HOME": str(folder)}
            os.execvp(name, [name, *ARGUMENTS[name]])
        self._type(SETUP[name] + f"source {script}\ntouch ready\n")
        self._wait_for(folder / "ready")

    def completed(self, line: str) -> str:
        """The command line after Tab was pressed at its end."""
        file = self._folder / "line"
        self._type(f"{line}\t\x18\x0c")
        self._wait_for(file)
        found = file.read_text().rstrip("\n")
        file.unlink()
        self._type("\x15")
        return found

    def close(self) -> None:
        """End the shell."""
        os.kill(self._process, signal.SIGKILL)
        os.close(self._terminal)
        os.waitpid(self._process, 0)

    def _type(self, text: str) -> None:
        os.write(self._terminal, text.encode())

    def _wait_for(self, file: Path) -> None:
        seen, end = b"", time.monotonic() + WAIT
        while not file.exists():
            assert time.monotonic() < end, f"the terminal shows {seen!r}"
            if select.select([self._terminal], [], [], 0.02)[0]:
                seen += os.read(self._terminal, 65536)
