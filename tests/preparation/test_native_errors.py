from pathlib import Path

import pytest

from gsfw.core.errors import ConfigError, DataError
from gsfw.preparation.native_errors import native_failure, readable_native_errors

ADVICE = (
    "Run the same command with a new out=DIR, so that features and matches are computed anew; if "
    "it fails again, report it with what is in DIR/work/log."
)


def test_what_colmap_throws_becomes_a_message_with_advice() -> None:
    with (
        pytest.raises(DataError) as failure,
        readable_native_errors("do it", Path("work/database.db")),
    ):
        raise ValueError("[sfm.cc:77] Check failed: it is so.")
    assert failure.value.message == (
        "COLMAP could not do it with work/database.db: Check failed: it is so."
    )
    assert failure.value.advice == ADVICE


def test_of_a_log_the_last_line_is_shown() -> None:
    error = native_failure(
        "do it", Path("d.db"), "I2026 [sfm.cc:1] begun\n\nValueError: broken\n\n"
    )
    assert error.message == "COLMAP could not do it with d.db: ValueError: broken."


def test_a_process_that_ends_without_a_word_is_said_to() -> None:
    error = native_failure("do it", Path("d.db"), "")
    assert error.message == "COLMAP could not do it with d.db: it stopped without a word."


def test_errors_of_users_pass_unchanged() -> None:
    with pytest.raises(ConfigError, match=r"^theirs$"), readable_native_errors("do it", Path("d")):
        raise ConfigError("theirs")


def test_other_errors_pass_unchanged() -> None:
    with pytest.raises(OSError, match="full"), readable_native_errors("do it", Path("d")):
        raise OSError("the disk is full")
