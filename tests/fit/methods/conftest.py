"""The rule that every error is whole holds for these tests."""

from tests.whole_errors import whole_errors  # noqa: F401
