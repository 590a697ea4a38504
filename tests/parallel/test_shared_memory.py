"""Exchange by shared memory: real processes get what they get through sockets."""

import pytest
from support.connected_processes import (
    all_operations,
    in_processes,
    one_with_another_token,
    one_without_memory,
)


def test_all_operations_return_what_sockets_return():
    in_processes(all_operations)


@pytest.mark.slow
@pytest.mark.parametrize("work", [one_without_memory, one_with_another_token])
def test_processes_without_common_memory_use_sockets(work):
    in_processes(work)
