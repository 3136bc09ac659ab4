from __future__ import annotations

import threading

import pytest

from terraport_pipeline.ordered import in_order


@pytest.mark.parametrize("threads", [1, 3])
def test_results_come_in_the_order_of_the_items(threads: int) -> None:
    assert list(in_order(lambda n: n * n, iter(range(50)), threads)) == [n * n for n in range(50)]


def test_items_are_taken_as_places_get_free() -> None:
    consumed: list[int] = []

    def items() -> object:
        for number in range(100):
            consumed.append(number)
            yield number

    results = in_order(lambda n: n, items(), 2)  # type: ignore[arg-type, var-annotated]
    assert next(results) == 0
    assert len(consumed) <= 8
    results.close()  # type: ignore[attr-defined]


def test_an_error_stands_where_its_result_would() -> None:
    started = threading.Semaphore(0)

    def work(number: int) -> int:
        started.release()
        if number == 2:
            raise ValueError("two")
        return number

    results = in_order(work, range(1000), 1)
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(ValueError, match="two"):
        next(results)
    assert started._value < 20
