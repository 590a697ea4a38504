"""The native engine under sanitizers: memory, undefined behaviour, and races of threads."""

from dataclasses import dataclass
from pathlib import Path

import pytest
from support.native_programs import (
    MACHINE,
    compile_engine,
    compile_source,
    compiler,
    linked_sets,
    run_program,
)

HERE = Path(__file__).parent

SANITIZERS = {
    # Unoptimised: the compiler removes nothing that is undefined.
    "address": [
        "-O0",
        "-fsanitize=address,undefined,float-cast-overflow",
        "-fno-sanitize-recover=all",
        "-fno-omit-frame-pointer",
    ],
    # Optimised: the programs run four times as fast, and compile in twice the time.
    "thread": ["-O1", "-fsanitize=thread"],
}

OPTIONS = {
    # The child of a fork starts threads of its own, which the sanitizer refuses unless told not to.
    "TSAN_OPTIONS": "die_after_fork=0",
}


@dataclass(frozen=True)
class Build:
    """The engine as one sanitizer wants it."""

    flags: list[str]
    objects: list[Path]
    folder: Path


@pytest.fixture(scope="module", params=list(SANITIZERS))
def build(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Compiled once for all programs."""
    folder = tmp_path_factory.mktemp(request.param)
    flags = ["-g1", *SANITIZERS[request.param]]  # Reports need lines, and no variables.
    _skip_without(request.param, flags, folder)
    return Build(flags, compile_engine(compiler(), linked_sets(MACHINE), flags, folder), folder)


def _skip_without(name: str, flags: list[str], folder: Path) -> None:
    nothing = folder / "nothing.cpp"
    nothing.write_text("int main() { return 0; }\n", encoding="utf-8")
    try:
        run_program([str(compile_source(compiler(), nothing, folder / "nothing", flags))])
    except AssertionError:
        pytest.skip(f"the C++ compiler of this machine has no {name} sanitizer that works")


@pytest.mark.native("kernels/cpu/native", "kernels/shared", "tests/kernels/cpu")
@pytest.mark.slow
@pytest.mark.parametrize(
    "program", ["render_check", "step_check", "field_check", "stereo_check", "pool_check"]
)
def test_sanitizers_find_nothing(build: Build, program: str) -> None:
    source, output = HERE / f"{program}.cpp", build.folder / program
    compile_source(compiler(), source, output, build.flags, build.objects)
    run_program([str(output)], **OPTIONS)
