"""The packs of every instruction set mean what single numbers mean."""

from pathlib import Path

import pytest
from support.native_programs import (
    EMULATOR,
    compile_source,
    compiler,
    cross_compiler,
    flags_of,
    run_program,
)

from gsfw.kernels.cpu.native_module import instruction_sets

CHECK = Path(__file__).with_name("vocabulary_check.cpp")

pytestmark = pytest.mark.native("kernels/cpu/native", "kernels/shared", "tests/kernels/cpu")


@pytest.mark.slow
@pytest.mark.parametrize("instruction_set", instruction_sets() or ["scalar"])
def test_packs_mean_what_numbers_mean(instruction_set: str, tmp_path: Path) -> None:
    flags = [*flags_of(instruction_set), "-O1"]
    run_program([str(compile_source(compiler(), CHECK, tmp_path / "check", flags))])


def test_packs_mean_what_numbers_mean_on_arm(tmp_path: Path) -> None:
    flags = [*flags_of("neon"), "-O1", "-static"]
    check = compile_source(cross_compiler(), CHECK, tmp_path / "check", flags)
    run_program([EMULATOR, str(check)])
