"""The two trees and their product against naive enumeration; limits that are told."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

import vision.paper.combinations
from vision.paper.binary import FIRST_LEFT, FIRST_RIGHT, VerticalPairs
from vision.paper.combinations import combine, most_hypotheses, most_nodes
from vision.paper.trees import Combinations, horizontal_tree, vertical_tree
from vision.paper.unary import UnaryPairs

Numbers = NDArray[np.int64]


def unary_pairs(rng: np.random.Generator, rows: int, lines: int, share: float) -> UnaryPairs:
    row, line = np.nonzero(rng.uniform(size=(rows, lines)) < share)
    return UnaryPairs(3 * row, line, np.zeros((len(row), 2)), np.zeros(len(row), np.int8), rows * lines)


def vertical_pairs(rng: np.random.Generator, rows: int, lines: int, share: float) -> VerticalPairs:
    row, line = (grid.ravel() for grid in np.meshgrid(np.arange(rows), np.arange(lines), indexing="ij"))
    count = len(row)
    said = np.where(rng.uniform(size=(count, count)) < share, rng.integers(1, 4, (count, count)), 0)
    said[(row[:, None] == row) | (line[:, None] == line)] = 0
    upper = np.triu(said, 1).astype(np.int8)
    exchanged = np.array([0, FIRST_RIGHT, FIRST_LEFT, 3], np.int8)[upper]
    return VerticalPairs(5 * row, line, upper + exchanged.T, 0, 0, 0)


def listed(found: Combinations) -> list[frozenset[int]]:
    return [frozenset(pairs[:size].tolist()) for pairs, size in zip(found.pairs, found.sizes, strict=True)]


def naive(rows: Numbers, lines: Numbers) -> set[frozenset[int]]:
    """All ways to give each row one of its pairs or none, each line once."""
    levels = [[-1, *np.flatnonzero(rows == row).tolist()] for row in np.unique(rows)]
    found = set()
    for choice in itertools.product(*levels):
        pairs = [pair for pair in choice if pair >= 0]
        if len({int(lines[pair]) for pair in pairs}) == len(pairs):
            found.add(frozenset(pairs))
    return found


@pytest.mark.parametrize("seed", range(5))
def test_the_first_tree_is_complete(seed: int) -> None:
    pairs = unary_pairs(np.random.default_rng(seed), 5, 5, 0.5)
    found = horizontal_tree(pairs, 100_000)
    assert found.complete
    assert len(listed(found)) == len(set(listed(found)))
    assert set(listed(found)) == naive(pairs.rows, pairs.lines)


def full_order(count: int, regions: int) -> NDArray[np.uint64]:
    return np.full((count, count, 1), (1 << regions) - 1, np.uint64)


def possible_regions(pairs: VerticalPairs, combination: frozenset[int], order: NDArray[np.uint64]) -> int:
    left = ~0
    for i in combination:
        left &= int(order[pairs.rows[i] // 5, pairs.rows[i] // 5, 0])
    for i, k in itertools.combinations(sorted(combination), 2):
        a, b, said = pairs.rows[i] // 5, pairs.rows[k] // 5, pairs.agrees[i, k]
        one = int(order[a, b, 0]) if said & FIRST_LEFT else 0
        other = int(order[b, a, 0]) if said & FIRST_RIGHT else 0
        left &= one | other
    return left


@pytest.mark.parametrize("seed", range(5))
def test_the_second_tree_is_complete(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = vertical_pairs(rng, 4, 4, 0.7)
    order = rng.integers(0, 16, (4, 4, 1)).astype(np.uint64)
    found = vertical_tree(pairs, order, 5 * np.arange(4), 100_000)
    expected = {frozenset[int]()}
    for combination in naive(pairs.rows, pairs.lines):
        couples = itertools.combinations(sorted(combination), 2)
        fits = len(combination) >= 2 and all(pairs.agrees[i, k] for i, k in couples)
        if fits and possible_regions(pairs, combination, order):
            expected.add(combination)
    assert len(expected) > 5
    assert len(listed(found)) == len(expected)
    assert set(listed(found)) == expected


def test_the_order_of_appearance_prunes() -> None:
    pairs = vertical_pairs(np.random.default_rng(0), 4, 4, 1.0)
    edges = 5 * np.arange(4)
    free = vertical_tree(pairs, full_order(4, 3), edges, 100_000)
    none = vertical_tree(pairs, np.zeros((4, 4, 1), np.uint64), edges, 100_000)
    assert len(free) > 50
    assert listed(none) == [frozenset()]


def test_regions_beyond_one_word_count() -> None:
    pairs = vertical_pairs(np.random.default_rng(0), 3, 3, 1.0)
    order = np.zeros((3, 3, 3), np.uint64)
    order[..., 2] = 1 << 5
    edges = 5 * np.arange(3)
    assert len(vertical_tree(pairs, order, edges, 1000)) == len(
        vertical_tree(pairs, full_order(3, 1), edges, 1000)
    )


def test_a_limit_that_is_reached_is_told() -> None:
    pairs = unary_pairs(np.random.default_rng(1), 6, 6, 0.6)
    every = horizontal_tree(pairs, 1_000_000)
    assert len(every) > 200
    some = horizontal_tree(pairs, 200)
    assert len(some) == 200
    assert not some.complete
    assert horizontal_tree(pairs, len(every)).complete
    assert set(listed(some)) <= set(listed(every))


def test_empty_trees_have_the_empty_combination() -> None:
    nothing = unary_pairs(np.random.default_rng(1), 0, 0, 0.6)
    assert listed(horizontal_tree(nothing, 10)) == [frozenset()]
    none = vertical_pairs(np.random.default_rng(1), 0, 0, 1.0)
    assert listed(vertical_tree(none, full_order(0, 1), np.zeros(0, np.int64), 10)) == [frozenset()]


def lists(seed: int) -> tuple[Combinations, Numbers, Combinations, Numbers]:
    rng = np.random.default_rng(seed)
    flat, upright = unary_pairs(rng, 4, 6, 0.4), vertical_pairs(rng, 3, 6, 0.5)
    second = vertical_tree(upright, full_order(3, 1), 5 * np.arange(3), 100_000)
    return horizontal_tree(flat, 100_000), flat.lines, second, upright.lines


@pytest.mark.parametrize("least", [0, 3, 4])
@pytest.mark.parametrize("seed", range(3))
def test_the_product_is_complete(seed: int, least: int) -> None:
    first, first_lines, second, second_lines = lists(seed)
    expected = set()
    for (h, flat), (v, upright) in itertools.product(enumerate(listed(first)), enumerate(listed(second))):
        used = [int(first_lines[pair]) for pair in flat] + [int(second_lines[pair]) for pair in upright]
        if len(set(used)) == len(used) >= least:
            expected.add((h, v))
    found = combine(first, first_lines, second, second_lines, least, 1_000_000)
    assert set(zip(found.horizontal.tolist(), found.vertical.tolist(), strict=True)) == expected
    assert len(found) == found.counted == len(expected)
    assert found.complete
    assert found.possible == len(first) * len(second)
    sizes = first.sizes[found.horizontal] + second.sizes[found.vertical]
    assert (np.diff(sizes) <= 0).all()


def test_a_budget_that_does_not_suffice_is_told() -> None:
    first, first_lines, second, second_lines = lists(0)
    every = combine(first, first_lines, second, second_lines, 3, 1_000_000)
    some = combine(first, first_lines, second, second_lines, 3, len(every) // 2)
    assert len(some) == len(every) // 2
    assert not some.complete
    assert some.counted == len(every)
    np.testing.assert_array_equal(some.horizontal, every.horizontal[: len(some)])
    assert combine(first, first_lines, second, second_lines, 3, len(every)).complete


def test_products_that_are_not_looked_at_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    first, first_lines, second, second_lines = lists(0)
    monkeypatch.setattr(vision.paper.combinations, "_MORE_LOOKS", 0)
    found = combine(first, first_lines, second, second_lines, 3, 10)
    every = combine(first, first_lines, second, second_lines, 3, 1_000_000)
    assert len(found) == 10
    assert not found.complete
    assert found.counted < every.counted


def test_the_example_of_section_3_6() -> None:
    # Five edges of each kind, ten lines of which five are vertical; printed as 240,660 with 10^5 for 11^5.
    assert round(11**10 / most_nodes(5, 5, 10, 5)) == 153_633
    assert most_hypotheses(5, 5, 10, 5) == 11**5 * 6**5
