"""`gsfw completion SHELL`: prints the script that completes command lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gsfw.commands.interface.arguments import Options, positional, read_options


@dataclass(kw_only=True)
class CompletionOptions(Options):
    """Print a script that completes verbs, keys, values and names of methods in your shell.

    bash: gsfw completion bash > ~/.local/share/bash-completion/completions/gsfw
    zsh: gsfw completion zsh > FOLDER/_gsfw, for a FOLDER of $fpath
    fish: gsfw completion fish > ~/.config/fish/completions/gsfw.fish

    The script knows what is installed now: write it again after an update, or a new plugin.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw completion bash > ~/.local/share/bash-completion/completions/gsfw",
        "source <(gsfw completion bash)",
    )

    shell: str = positional("bash|zsh|fish")
    """The shell."""


def run(arguments: list[str]) -> int:
    """Print the script."""
    options = read_options("completion", CompletionOptions, arguments)
    from gsfw.commands.interface.completion_scripts import SCRIPTS, completion_script
    from gsfw.commands.interface.completion_table import completion_table
    from gsfw.commands.interface.console import Console
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.registry import did_you_mean, installed

    if options.shell not in SCRIPTS:
        raise ConfigError(
            f"gsfw completion: there is no script for {options.shell!r}."
            f"{did_you_mean(options.shell, SCRIPTS)}",
            f"Shells: {', '.join(SCRIPTS)}.",
        )
    script = completion_script(options.shell, completion_table(installed()))
    console = Console(options.json)
    if not options.json:
        console.say(script.rstrip("\n"))
    console.result({"shell": options.shell, "script": script})
    return 0
