"""Loops in pieces: everything once, in order, with any number of threads."""

from __future__ import annotations

import pytest

from terraport_pipeline.geometry.mesh.chunks import CHUNK, in_chunks, side_by_side


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("n_items", [0, 1, 6, 7, 8, 100])
def test_pieces_are_the_same_whatever_the_threads(n_items, threads):
    pieces = in_chunks(lambda begin, end: (begin, end), n_items, threads=threads, chunk=7)
    assert [i for begin, end in pieces for i in range(begin, end)] == list(range(n_items))
    assert all(end - begin == 7 for begin, end in pieces[:-1])


def test_default_pieces_are_whole_chunks():
    assert in_chunks(lambda begin, end: end, CHUNK + 1) == [CHUNK, CHUNK + 1]


@pytest.mark.parametrize("threads", [1, 2])
def test_errors_reach_the_caller(threads):
    def work(begin, end):
        raise ValueError(f"piece {begin}")

    with pytest.raises(ValueError, match="piece 0"):
        in_chunks(work, 10, threads=threads, chunk=2)
    with pytest.raises(ZeroDivisionError):
        side_by_side([lambda: 1, lambda: 1 // 0], threads=threads)


@pytest.mark.parametrize("threads", [1, 2])
def test_side_by_side_keeps_the_order(threads):
    assert side_by_side([lambda i=i: i for i in range(5)], threads=threads) == [0, 1, 2, 3, 4]
