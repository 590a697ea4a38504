"""The native engine on ARM, emulated: NEON where the machine is none that has it."""

from pathlib import Path

import pytest
from support.native_programs import (
    EMULATOR,
    compile_engine,
    compile_source,
    cross_compiler,
    linked_sets,
    run_program,
)

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Objects for ARM."""
    folder = tmp_path_factory.mktemp("arm")
    return compile_engine(cross_compiler(), linked_sets("aarch64"), ["-O1"], folder)


@pytest.mark.native("kernels/cpu/native", "kernels/shared", "tests/kernels/cpu")
@pytest.mark.slow
@pytest.mark.parametrize("program", ["render_check", "step_check", "field_check", "stereo_check"])
def test_arm_agrees_with_float64(engine: list[Path], program: str, tmp_path: Path) -> None:
    source, flags = HERE / f"{program}.cpp", ["-O1", "-static"]
    check = compile_source(cross_compiler(), source, tmp_path / program, flags, engine)
    run_program([EMULATOR, str(check), "emulated"])
