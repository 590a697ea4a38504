"""YAML text, parsed within bounds: plain data only, and no larger than it looks.

An alias repeats what its anchor names, so that a few lines can stand for more than memory holds.
The size of a document is counted before it is built.
"""

from __future__ import annotations

import re
from contextlib import suppress
from typing import Any

import yaml

from gsfw.core.files.json_text import DEEPEST

LARGEST = 100_000
"""Most nodes of a document, with those that aliases repeat; a configuration has a few hundred."""
MOST_BRACKETS, BRACKET = 5 * DEEPEST, re.compile(r"[][{}]")
"""Most brackets that are open at a time."""
TOO_DEEP = "it is nested too deeply"
FAST_LOADER: type = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The safe loader, ten times faster where PyYAML was built with libyaml."""


def parsed_yaml(text: str, loader: type = FAST_LOADER) -> Any:  # noqa: ANN401 - plain data
    """Plain data of YAML.

    Args:
        text: the document.
        loader: a subclass of ``yaml.SafeLoader``, or of its fast form.

    Raises:
        YAMLError: it is no YAML, is nested too deeply, or stands for too much.
    """
    _check_brackets(text)
    if not issubclass(loader, FAST_LOADER):
        # The bounds first, as slow loaders take seconds for thousands of brackets. They tell other
        # errors in words of their own.
        with suppress(yaml.MarkedYAMLError):
            parsed_yaml(text)
    made = loader(text)
    try:
        node = made.get_single_node()
        if node is None:
            return None
        if _nodes(node, 1, {}) > LARGEST:
            raise yaml.YAMLError(f"its aliases make it larger than {LARGEST:,} nodes")
        return made.construct_document(node)
    except RecursionError:
        raise yaml.YAMLError(TOO_DEEP) from None
    except yaml.MarkedYAMLError as error:
        if "nesting depth" in str(error.problem):  # libyaml has a limit of its own.
            raise yaml.YAMLError(TOO_DEEP) from None
        raise
    except ValueError as error:  # A date or a number that is none.
        raise yaml.YAMLError(str(error)) from None
    finally:
        made.dispose()


def _check_brackets(text: str) -> None:
    """Check that brackets are not open by the thousand: for each token, YAML looks at all of them.

    Those in texts and comments count too, so that the limit is above that of lists.

    Raises:
        YAMLError: they are.
    """
    if text.count("[") + text.count("{") <= MOST_BRACKETS:
        return
    depth = 0
    for bracket in BRACKET.findall(text):
        depth += 1 if bracket in "[{" else -1
        if depth > MOST_BRACKETS:
            raise yaml.YAMLError(TOO_DEEP)


def _nodes(node: yaml.Node, depth: int, counted: dict[int, int]) -> int:
    """Number of nodes that a node stands for.

    Raises:
        YAMLError: it is nested too deeply, or holds itself.
    """
    if depth > DEEPEST:
        raise yaml.YAMLError(f"it is nested more than {DEEPEST} levels deep")
    if id(node) in counted:
        return counted[id(node)]
    children: list[yaml.Node] = []
    if isinstance(node, yaml.MappingNode):
        children = [item for pair in node.value for item in pair]
    elif isinstance(node, yaml.SequenceNode):
        children = node.value
    total = 1 + sum(_nodes(child, depth + 1, counted) for child in children)
    counted[id(node)] = total
    return total
