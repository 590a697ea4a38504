"""What a budget may say, and how many rows that is."""

import pytest
from support.gaussians import gaussians, toy_scene

from gsfw.core.errors import ConfigError
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
