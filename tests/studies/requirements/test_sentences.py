"""What people read: what was left out, what could be, and what to try."""

from gsfw.core.datamanager import Split
from gsfw.core.loop.requirements import LeastUseful, Motion
from gsfw.studies.requirements.census import Census
from gsfw.studies.requirements.sentences import could_go, decibels, headline, left_out, percent
from gsfw.studies.requirements.worth import Worth

CLASSIC = Census(
    {"positions": 300, "SH band 0": 300, "SH band 1": 900, "SH band 2": 1500, "SH band 3": 2100},
    {}, rows_by_degree=(0, 0, 0, 100), highest_degree=3, rows_without_time=0,
)  # fmt: skip
ADAPTIVE = Census(
    {"positions": 300, "SH band 0": 300, "SH band 1": 351, "SH band 2": 120},
    {}, rows_by_degree=(61, 31, 8), highest_degree=3, rows_without_time=25,
)  # fmt: skip
OTHER = Census({"points": 1500}, {}, (), highest_degree=0, rows_without_time=0)
SETTINGS = {"sh_degree": 3, "sh": "uniform", "strategy.budget": "none"}


def worth(bands=(), least_useful=(), motion=None):
    return Worth(("v0",), Split.EVAL, 30.0, tuple(bands), tuple(least_useful), motion)


def test_rows_of_lower_degree_leave_out_the_bands_above_it():
    assert left_out(CLASSIC, 100) == ()
    assert left_out(ADAPTIVE, 100) == (
        "bands 1 to 3 of 61 % of the Gaussians",
        "bands 2 to 3 of 31 % of the Gaussians",
        "band 3 of 8 % of the Gaussians",
        "time parameters of 25 % of the Gaussians, which stand still",
    )


def test_upper_bands_that_bring_hardly_anything_name_what_to_try():
    found = worth(bands=(0.8, 0.03, 0.01))
    assert could_go(CLASSIC, found, SETTINGS) == (
        "bands 2 to 3 bought 0.04 dB (try sh=adaptive or sh_degree=1)",
    )
    assert could_go(CLASSIC, found, SETTINGS | {"sh": "adaptive"}) == (
        "bands 2 to 3 bought 0.04 dB (try sh_degree=1)",
    )
    assert could_go(CLASSIC, found, {}) == ("bands 2 to 3 bought 0.04 dB",)
    assert could_go(CLASSIC, worth(bands=(0.8, 0.03, 0.06)), SETTINGS) == ()


def test_gaussians_that_bring_hardly_anything_name_what_to_try():
    parts = [
        LeastUseful(0.1, 0.001, 0.0),
        LeastUseful(0.25, 0.004, 0.01),
        LeastUseful(0.5, 0.1, 2.0),
    ]
    said = (
        "the least useful 25 % of the Gaussians hold 0.4 % of the contribution and bought 0.01 dB"
    )
    assert could_go(OTHER, worth(least_useful=parts), {}) == (said,)
    assert could_go(OTHER, worth(least_useful=parts), SETTINGS) == (
        f"{said} (try strategy.budget=auto)",
    )
    assert could_go(OTHER, worth(least_useful=parts[:1]), SETTINGS) == ()


def test_bands_that_were_not_drawn_yet_are_named():
    assert could_go(CLASSIC, worth(bands=(0.8,)), SETTINGS) == (
        "bands 2 to 3: training ended before they were rendered",
    )


def test_the_headline_says_what_colours_cost_and_brought():
    found = worth(bands=(0.8, 0.1, 0.02))
    assert headline(CLASSIC, worth(bands=(0.8, 0.1, 0.06)), SETTINGS, 100) == (
        "colour takes 48 numbers for each Gaussian; PSNR falls by 0.16 dB without bands 2 to 3"
    )
    assert headline(CLASSIC, found, SETTINGS, 100) == (
        "colour takes 48 numbers for each Gaussian; PSNR falls by 0.02 dB without band 3 "
        "(try sh=adaptive or sh_degree=2)"
    )
    assert headline(ADAPTIVE, worth(bands=(0.8, 0.1)), SETTINGS, 100) == (
        "colour takes 7.71 numbers for each Gaussian (48 with every band); PSNR falls by 0.10 dB "
        "without band 2"
    )
    assert headline(OTHER, worth(motion=Motion(3.456, 0.5)), SETTINGS, 100) == (
        "the model takes 1,500 numbers; PSNR falls by 3.46 dB without motion"
    )


def test_figures_are_rounded_as_people_write_them():
    assert [percent(part) for part in (0.0, 5e-5, 0.00412, 0.0995, 0.61, 1.0)] == [
        "0 %", "under 0.01 %", "0.41 %", "10 %", "61 %", "100 %",
    ]  # fmt: skip
    assert [decibels(value) for value in (-0.001, 0.125, -0.3)] == [
        "0.00 dB",
        "0.12 dB",
        "-0.30 dB",
    ]
