"""The headers themselves: each compiles alone, without warnings or the standard library."""

import subprocess
from pathlib import Path

import pytest

HEADERS = sorted((Path(__file__).resolve().parents[3] / "kernels" / "shared").glob("*.h"))


@pytest.mark.parametrize("header", HEADERS, ids=lambda header: header.name)
def test_a_header_compiles_alone_without_the_standard_library(compiler, header):
    # Without include paths any system header would be an error, as it is where NVRTC compiles.
    strict = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-nostdinc"]
    source = f'#include "{header.name}"\n'
    subprocess.run(
        [compiler, *strict, f"-I{header.parent}", "-x", "c++", "-"],
        input=source,
        text=True,
        check=True,
    )


def test_no_template_warns_for_any_number_type(compiler):
    strict = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    source = Path(__file__).with_name("library.cpp")
    subprocess.run([compiler, *strict, f"-I{HEADERS[0].parent}", str(source)], check=True)


@pytest.mark.parametrize("header", HEADERS, ids=lambda header: header.name)
def test_a_header_is_short_and_takes_its_copy_of_every_instruction_set(header):
    lines = header.read_text().splitlines()
    assert len(lines) <= 400
    assert max(map(len, lines)) <= 100
    has_code = any("GSFW_FUNCTION" in line or "template" in line for line in lines)
    assert "namespace GSFW_ISA {" in lines or not has_code
    assert not any("std::" in line for line in lines)
