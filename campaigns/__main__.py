"""Runs campaigns: python campaigns [NAME] [--size N] [--seed N]."""

from __future__ import annotations

import argparse
import datetime
import sys
import time
from importlib import import_module

from campaign import Campaign, Record, commit, machine
from promises import write_page

CAMPAIGNS: tuple[str, ...] = (
    *("damaged_inputs", "interruptions", "failing_disks", "power_loss", "races"),
    *("endurance", "wild_training", "no_network", "processors"),
)
"""Modules with a ``CAMPAIGN``, in the order of the page."""


def main(arguments: list[str]) -> int:
    """Run the campaigns that are asked for and write the page; 1 if a promise does not hold."""
    campaigns = {each.name: each for each in map(_campaign, CAMPAIGNS)}
    parser = argparse.ArgumentParser(prog="python campaigns", description=__doc__)
    choices = [*campaigns, "table"]
    parser.add_argument("name", nargs="?", choices=choices, help="one campaign; otherwise all")
    parser.add_argument("--size", type=int, help="executions, crash points, steps, ...")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    if options.name == "table":
        _say(str(write_page()))
        return 0
    asked = [campaigns[options.name]] if options.name else [*campaigns.values()]
    records = [_run(each, options.size or each.full, options.seed) for each in asked]
    _say(str(write_page()))
    return 0 if all(each.holds for record in records for each in record.promises) else 1


def _campaign(module: str) -> Campaign:
    found: Campaign = import_module(module).CAMPAIGN
    return found


def _run(campaign: Campaign, size: int, seed: int) -> Record:
    _say(f"{campaign.name}: {campaign.summary} ({size:,} {campaign.counts}, seed {seed})")
    begin = time.monotonic()
    outcome = campaign.run(size, seed, lambda line: _say(f"  {line}"))
    record = Record(
        campaign.name,
        datetime.date.today().isoformat(),
        f"python campaigns {campaign.name} --size {size} --seed {seed}",
        machine(),
        commit(),
        round(time.monotonic() - begin, 1),
        list(outcome.promises),
        list(outcome.details),
        list(outcome.failures),
    )
    for each in record.promises:
        _say(f"  {'holds' if each.holds else 'BROKEN'}: {each.promise} {each.figure}")
    for line in record.failures:
        _say(f"  {line}")
    record.write()
    return record


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
