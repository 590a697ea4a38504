"""What a budget may say, and how many rows that is."""

import pytest
from support.gaussians import gaussians, toy_scene

from gsfw.core.errors import ConfigError
from gsfw.core.ranges import check_ranges
from gsfw.core.refinement.budget import BudgetSize, with_budget
from gsfw.strategies.adc import AdcConfig
from gsfw.strategies.mcmc import McmcConfig
from gsfw.strategies.none import NoneConfig

STRATEGIES = pytest.mark.parametrize("kind", [AdcConfig, McmcConfig, NoneConfig])


def test_a_number_is_that_many_rows_and_auto_and_none_leave_it_open():
    model = gaussians(20)
    found = {text: BudgetSize.parse(AdcConfig(budget=text)) for text in ("none", "auto", "50000")}
    assert [found[text].most_rows(model) for text in found] == [None, None, 50_000]
    assert [found[text].is_given for text in found] == [False, True, True]


def test_megabytes_are_rows_of_the_mean_size_that_they_have():
    model = gaussians(20, degree=1)  # 3 + 4 + 3 + 1 + 12 numbers of 4 bytes.
    budget = BudgetSize.parse(AdcConfig(budget="0.00092MB"))
    assert budget.most_rows(model) == 10
    assert BudgetSize.parse(AdcConfig(budget="20MB")).most_rows(model) == 20_000_000 // 92
    assert BudgetSize.parse(AdcConfig(budget="0.00001MB")).most_rows(model) == 1


@STRATEGIES
@pytest.mark.parametrize("text", ["lots", "0", "-5", "3GBB", "0MB", "1e5", "MB", ""])
def test_what_is_no_budget_is_refused(kind, text):
    with pytest.raises(ConfigError) as caught:
        with_budget(kind(budget=text), toy_scene())
    assert caught.value.message == (
        f"strategy.budget={text}: expected none, auto, a number of Gaussians such as 50000, "
        "or megabytes such as 20MB."
    )


@STRATEGIES
@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"budget_every": 0}, "strategy.budget_every=0: expected a number of at least 1."),
        ({"budget_share": 0.0}, "strategy.budget_share=0: expected a number above 0 and below 1."),
        ({"budget_share": 1.0}, "strategy.budget_share=1: expected a number above 0 and below 1."),
    ],
)
def test_settings_out_of_range_are_refused(kind, settings, said):
    with pytest.raises(ConfigError) as caught:
        check_ranges(kind(**settings), "strategy.")
    assert caught.value.message == said
