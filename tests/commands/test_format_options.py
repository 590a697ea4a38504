"""Options of formats, formats that are folders, and double suffixes: for the verbs and programs."""

import json
from dataclasses import dataclass
from pathlib import Path

import pytest
from reference.settings import settings_pages

from gsfw.api import ConfigError
from gsfw.api import open as open_run
from gsfw.commands.interface.completion_table import completion_table
from gsfw.commands.main import main
from gsfw.core.exchange import Exporter
from gsfw.formats.compressed_ply import CompressedPlyExporter
from gsfw.plugins.exporters import check_suffix, exporter_options, format_of, make_exporter
from gsfw.plugins.registry import installed

pytestmark = pytest.mark.unchecked

PLUGIN = '''
from dataclasses import dataclass
from typing import Literal

from gsfw.api import ConfigError, Exporter, Spec, hookimpl


@dataclass(frozen=True)
class Dots(Exporter):
    """Writes its own options and the number of splats."""

    suffix = ".small.dots"
    version: int = 3
    """Version of the format."""
    colors: Literal["all", "none"] = "all"
    """What is written of the colours."""

    def __post_init__(self):
        if not 1 <= self.version <= 4:
            raise ConfigError(f"format.version={self.version}: expected 1 to 4.", "Take 3.")

    def write(self, path, source):
        path.write_text(f"{self.version} {self.colors} {len(source.splat_file().splats)}")


class Plain(Exporter):
    suffix = ".dots"

    def write(self, path, source):
        path.write_text("plain")


class Arrays(Exporter):
    suffix = ".npz"


class Site(Exporter):
    suffix = ""
    is_folder = True

    def write(self, path, source):
        (path / "parts").mkdir(parents=True, exist_ok=True)
        (path / "parts" / "a").write_text("abc")
        (path / "index").write_text("12345")


@hookimpl
def gsfw_exporters():
    place = "formats_of_a_test:"
    return [
        Spec("arrays", "the suffix of gsfw's tracks", place + "Arrays"),
        Spec("dots", "dots", place + "Dots"),
        Spec("plain", "plain dots", place + "Plain"),
        Spec("site", "a folder", place + "Site"),
    ]
'''


@pytest.fixture(autouse=True)
def _formats(tmp_path, plugin_path):
    (tmp_path / "formats_of_a_test.py").write_text(PLUGIN)
    plugin_path(tmp_path / "formats_of_a_test.py")


def test_options_are_parsed_and_reach_the_exporter(finished_run, tmp_path):
    out = tmp_path / "a.small.dots"
    line = [
        "export",
        str(finished_run),
        f"out={out}",
        "format.version=4",
        "--format.colors",
        "none",
    ]
    assert main(line) == 0
    assert out.read_text().startswith("4 none ")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            "format.versoin=4",
            "error: format.versoin=4: format dots has no option 'versoin'. Did you mean "
            "'format.version'?\nOptions of dots: format.version=3, format.colors=all. What they "
            "do: gsfw export format=dots --help\n",
        ),
        (
            "format.version=four",
            "error: format.version=four: expected a whole number, found 'four'.\n"
            "format.version: Version of the format.\n",
        ),
        (
            "format.colors=red",
            "error: format.colors=red: expected one of all, none, found 'red'.\n"
            "format.colors: What is written of the colours.\n",
        ),
        ("format.version=9", "error: format.version=9: expected 1 to 4.\nTake 3.\n"),
    ],
)
def test_a_wrong_option_is_refused_with_those_of_the_format(given, message, tmp_path, capsys):
    assert main(["export", "nothing", f"out={tmp_path / 'a'}", "format=dots", given]) == 2
    assert capsys.readouterr().err == message


@pytest.mark.parametrize(
    ("form", "option", "value"),
    [
        ("sog", "palette", -1),
        ("points", "min_opacity", 2),
        ("ply", "order", "x"),
        ("spz", "sh_bits", 1),
    ],
)
def test_a_value_out_of_range_is_named_by_its_key(form, option, value):
    with pytest.raises(ConfigError) as refused:
        make_exporter(form, installed(), {option: value})
    assert str(refused.value).startswith(f"format.{option}={value}: expected ")


def test_a_format_without_options_says_so(capsys):
    assert main(["export", "latest", "format=plain", "format.x=1"]) == 2
    assert capsys.readouterr().err == (
        "error: format.x=1: format plain has no option 'x'.\nIt has no options.\n"
    )


def test_the_help_explains_the_options_of_the_given_format(capsys):
    assert main(["export", "--help"]) == 0
    assert "format=NAME --help" in " ".join(capsys.readouterr().out.split())
    assert main(["export", "format=dots", "--help"]) == 0
    section = capsys.readouterr().out.partition("format dots: dots\n")[2]
    assert [line.split()[0] for line in section.splitlines()] == [
        "format.version=3", "format.colors=all",
    ]  # fmt: skip
    assert "What is written of the colours." in section
    assert main(["export", "format=plain", "--help"]) == 0
    assert capsys.readouterr().out.endswith("format plain: plain dots\n  It has no options.\n")


@pytest.mark.slow
def test_options_are_completed_and_in_the_reference():
    assert "export format=dots|format.colors=|all none" in completion_table(installed())
    text = dict(settings_pages(installed()))["formats"]
    assert "\n## dots\n" in text
    assert "| `format.version` | whole number | `3` |" in text


def test_the_longest_suffix_chooses_the_format():
    assert format_of(Path("a.small.dots"), installed()) == "dots"
    assert format_of(Path("A.SMALL.DOTS"), installed()) == "dots"
    assert format_of(Path("a.large.dots"), installed()) == "plain"
    assert format_of(Path("a.ply"), installed()) == "ply"
    assert format_of(Path("a.npz"), installed()) == "tracks"  # A plugin changes no command.
    assert format_of(Path("site"), installed()) is None


def test_a_format_may_have_the_suffix_of_another_one():
    class Packed(CompressedPlyExporter):
        """Has the name of files of compressed-ply."""

    check_suffix(Path("z.compressed.ply"), "packed", Packed(), installed())
    check_suffix(Path("z.ply"), "packed", Packed(), installed())
    with pytest.raises(ConfigError, match=r"have format spz, and format=packed is given"):
        check_suffix(Path("z.spz"), "packed", Packed(), installed())


def test_a_format_that_is_a_folder_is_written_where_out_says(finished_run, tmp_path, capsys):
    (tmp_path / "www").mkdir()
    line = ["export", str(finished_run), "format=site", f"out={tmp_path / 'www'}", "json=true"]
    assert main(line) == 0
    assert (tmp_path / "www" / "index").is_file()
    document = json.loads(capsys.readouterr().out)
    assert (document["bytes"], document["written"]) == (8, str(tmp_path / "www"))


def test_programs_give_options_by_name(finished_run, tmp_path):
    run = open_run(finished_run)
    out = run.export(tmp_path / "a.small.dots", options={"version": 1})
    assert out.read_text().startswith("1 all ")
    assert run.model.save(tmp_path / "b", format="plain").read_text() == "plain"
    with pytest.raises(ConfigError, match="has no option 'size'"):
        run.model.save(tmp_path / "c", format="dots", options={"size": 2})


def test_an_option_needs_a_default_and_a_readable_type():
    @dataclass(frozen=True)
    class Fine(Exporter):
        suffix = ".x"
        level: int | None = None

        def write(self, path, source):
            pass

    assert [key.name for key in exporter_options(Fine)] == ["format.level"]
    assert make_exporter("ply", installed()).suffix == ".ply"
