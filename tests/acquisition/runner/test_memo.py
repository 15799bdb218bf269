"""The memo of slow functions: computes once for a key, forgets the oldest, keeps no failure."""

import pytest

from acquisition.runner.memo import Memo


def test_memo_same_key_computes_once() -> None:
    memo, computed = Memo[int](2), list[str]()

    def answer() -> int:
        computed.append("a")
        return 7

    assert [memo.of("a", answer) for _ in range(3)] == [7, 7, 7]
    assert computed == ["a"]


def test_memo_beyond_its_size_forgets_what_was_asked_for_least_recently() -> None:
    memo = Memo[int](2)
    memo.of("a", lambda: 1)
    memo.of("b", lambda: 2)
    memo.of("a", lambda: -1)
    memo.of("c", lambda: 3)
    assert [memo.of(key, lambda: -1) for key in "acb"] == [1, 3, -1]


def test_memo_failure_is_raised_and_not_kept() -> None:
    memo = Memo[float](2)
    with pytest.raises(ZeroDivisionError):
        memo.of("a", lambda: 1 / 0)
    assert memo.of("a", lambda: 1.0) == 1.0
