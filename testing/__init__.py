"""The conformance kit: what gsfw expects of the parts of plugins, as functions and tests.

A test file of a plugin needs two lines; pytest then shows one test for each promise::

    from gsfw.testing import conformance

    test_conforms = conformance("method", "my-method")

``check_method("my-method")`` and its neighbours need no pytest. ``gsfw plugins check NAME`` runs
the same promises. See docs/plugins/conformance.md.
"""

from gsfw.testing.checks import (
    ConformanceError,
    check,
    check_callback,
    check_command,
    check_datamanager,
    check_exporter,
    check_importer,
    check_method,
    check_metric,
    check_operators,
    check_plugin,
    check_rasterizer,
    check_sampler,
    check_strategy,
    outcomes,
    promises,
)
from gsfw.testing.promise import BrokenPromise, NotApplicable, Outcome, Promise, Verdict
from gsfw.testing.pytest_tests import conformance
from gsfw.testing.subject import Subject, find_subject, parts_of

__all__ = [
    "BrokenPromise",
    "ConformanceError",
    "NotApplicable",
    "Outcome",
    "Promise",
    "Subject",
    "Verdict",
    "check",
    "check_callback",
    "check_command",
    "check_datamanager",
    "check_exporter",
    "check_importer",
    "check_method",
    "check_metric",
    "check_operators",
    "check_plugin",
    "check_rasterizer",
    "check_sampler",
    "check_strategy",
    "conformance",
    "find_subject",
    "outcomes",
    "parts_of",
    "promises",
]
