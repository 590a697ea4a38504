"""What gsfw needs at run time is not under the GPL, by the metadata of what is installed."""

import pytest
from licences import EXTRAS, PAGE, is_copyleft, licence, needed


def test_no_package_that_gsfw_needs_is_under_the_gpl():
    found = {name: licence(package) for name, package in needed(EXTRAS).items()}
    assert {"numpy", "torch", "scipy", "pillow"} <= found.keys()
    assert not {name: stated for name, stated in found.items() if is_copyleft(stated)}


@pytest.mark.parametrize(
    "name",
    [
        "GPL-3.0-or-later",
        "AGPL-3.0-only",
        "GNU General Public License v3 (GPLv3)",
        "MIT AND GPL-2.0-only",
        "GNU Affero General Public License v3",
    ],
)
def test_the_gpl_is_found_by_any_of_its_names(name):
    assert is_copyleft(name)


@pytest.mark.parametrize(
    "name",
    [
        "MIT",
        "LGPL-3.0-only",
        "GNU Lesser General Public License v3 (LGPLv3)",
        "GPL-3.0-only WITH GCC-exception-3.1",
        "MIT OR GPL-2.0-only",
        "Mozilla Public License 2.0 (MPL 2.0)",
    ],
)
def test_other_licences_are_not_taken_for_it(name):
    assert not is_copyleft(name)


def test_the_reader_of_ply_that_tests_use_is_under_the_gpl_and_is_not_needed():
    assert "plyfile" not in needed(EXTRAS)


def test_the_page_has_the_packages_that_gsfw_names_itself():
    named = needed()["torch"].metadata["Name"], "numpy", "scipy", "pycolmap", "viser", "ray", "av"
    text = PAGE.read_text(encoding="utf-8")
    assert not [name for name in named if f"| {name} |" not in text]
