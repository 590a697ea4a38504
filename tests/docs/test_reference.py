"""The generated pages: every verb, setting and public name is there, and links lead somewhere."""

import posixpath
from itertools import filterfalse
from pathlib import Path

import pytest
from reference import built_in, reference_pages
from support.links import anchors, is_external, links

from gsfw import api
from gsfw.plugins.keys import SLOT_KEYS, keys
from gsfw.plugins.loading import callback_configs, load_all

# What is checked are texts; shapes are those of other tests.
pytestmark = pytest.mark.unchecked

DOCS = Path(__file__).resolve().parents[2] / "docs"
WRITTEN = sorted(DOCS.rglob("*.md"))


@pytest.fixture(scope="module")
def generated():
    """Texts of the generated pages by name, such as "settings/run"."""
    return dict(reference_pages())


def test_every_verb_has_a_section_with_its_options(generated):
    text = generated["verbs"]
    for verb in built_in().slot("command"):
        assert f"\n## {verb}\n" in text
    assert "| `channel` |" in text
    assert "gsfw runs compare runs/fox" in text, "examples of the help"


def test_every_setting_of_every_part_is_there_with_a_sentence(generated):
    text = "".join(page for name, page in generated.items() if name.startswith("settings/"))
    rows = {line.split(" | ")[0].strip("| `"): line for line in text.splitlines() if "|" in line}
    expected = {
        key.name for kind in load_all("method", built_in()).values() for key in keys(kind())
    }
    for slot in SLOT_KEYS:
        for kind in load_all(slot, built_in()).values():
            expected |= {key.name for key in keys(kind(), f"{slot}.")}
    expected |= {key.name for key in keys(callback_configs(built_in()), "callbacks.")}
    assert len(expected) > 200
    assert not expected - rows.keys()
    assert not [row for key, row in rows.items() if key in expected and row.endswith("|  |")]


def test_a_setting_has_type_default_and_range(generated):
    text = generated["settings/strategy"].replace("\N{NO-BREAK SPACE}", " ")
    assert "| `strategy.budget_share` | number | `0.025` | > 0, < 1 | Under" in text
    assert "| `strategy.refine_every` | steps | `100` | ≥ 1 | Steps" in text


def test_every_public_name_is_described(generated):
    for group in api.GROUPS:
        text = generated[f"api/{group}"]
        sections = text.split("\n## ")[1:]
        names = {section.partition("\n")[0]: section for section in sections}
        assert len(names) > 1
        for name, section in names.items():
            assert hasattr(api, name)
            sentences = [line for line in section.splitlines()[1:] if line and line[0] not in "`|"]
            assert sentences, name
    assert "#### " not in "".join(generated.values())


def test_fields_below_which_a_sentence_stands_show_it(generated):
    row = "| `max_channels` | `int \\| None` | `None` | Most channels"
    assert row in generated["api/configuration"]
    assert "@abstractmethod" in generated["api/training"]


def target_of(page: str, link: str) -> tuple[str, str]:
    """The page within docs/ that a link leads to, and the anchor there."""
    path, _, anchor = link.partition("#")
    folder = posixpath.dirname(page)
    return (posixpath.normpath(posixpath.join(folder, path)) if path else page), anchor


def test_links_of_and_to_the_generated_pages_lead_somewhere(generated):
    pages = {page.relative_to(DOCS).as_posix(): page.read_text("utf-8") for page in WRITTEN}
    made = {f"reference/{name}.md": text for name, text in generated.items()}
    known = {name: anchors(text) for name, text in {**pages, **made}.items()}
    broken = []
    for name, text in {**pages, **made}.items():
        for link in filterfalse(is_external, links(text)):
            target, anchor = target_of(name, link)
            concerned = name in made or target.startswith("reference/")
            if concerned and (target not in known or (anchor and anchor not in known[target])):
                broken.append(f"{name}: {link}")
    assert not broken
