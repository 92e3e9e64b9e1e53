"""Levenberg-Marquardt over a whole drive, with the spread of each kind of error estimated from its residuals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotri
from scipy.sparse import csr_array, diags_array

from maps.poses import Array, frozen
from runs.robotproblem import ROBOT, Block, Problem, State


@dataclass(frozen=True, slots=True)
class SolveConfig:
    """When to stop.

    `settled`: a step that gains less log-likelihood than this is the last. `spread_limits`: how many times better
    or worse than expected errors of a kind may turn out; `least_wheels`: the same of encoders, as a slip that has
    not happened yet does not show in a minute's drive. `least_redundancy`: with fewer residuals to spare their
    spread is not estimated. `same_spread`: relative change below which they have settled, too.
    """

    max_steps: int = 30
    settled: float = 1e-2
    spread_rounds: int = 6
    same_spread: float = 0.03
    spread_limits: tuple[float, float] = (0.3, 5.0)
    least_wheels: float = 1.0
    least_redundancy: float = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The likeliest state; `covariance` (10, 10) of the robot's parameters; `spreads` by kind of error, over what
    was expected.
    """

    state: State
    covariance: Array
    spreads: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", frozen(self.covariance))

    @property
    def std(self) -> Array:
        """The robot's parameters' standard deviations, (10,)."""
        result: Array = np.sqrt(np.diag(self.covariance))
        return result


def solve(problem: Problem, start: State, config: SolveConfig | None = None) -> Solution:
    """Find the likeliest state from a start.

    In turn the state for given spreads, and the spreads from the residuals, as in variance component estimation
    (Foerstner 1979): a kind of error's weighted sum of squares over what of its residuals is not used up.
    """
    config = config or SolveConfig()
    spreads = {name: 1.0 for name, block in problem.blocks(start).items() if block.scaled}
    state = start
    for _ in range(config.spread_rounds):
        state = _likeliest(problem, state, spreads, config)
        before, spreads = spreads, _spreads(problem.blocks(state), spreads, problem.record.by_wheels, config)
        if all(abs(spreads[name] / before[name] - 1.0) < config.same_spread for name in spreads):
            break
    state = _likeliest(problem, state, spreads, config)
    parts = _informations(problem.blocks(state), spreads, expected=True)
    covariance = _inverse(_total(parts))[:ROBOT, :ROBOT]
    return Solution(state, 0.5 * (covariance + covariance.T), spreads)


def torn(problem: Problem, solution: Solution, gate_chi2: float) -> NDArray[np.bool_]:
    """Return which views (F,) odometry contradicts on both sides: an image that was matched elsewhere.

    Its lines agree with each other, so no single one of them looks wrong.
    """
    motion = problem.blocks(solution.state)["motion"]
    contradicted = _squares(motion) > gate_chi2 * solution.spreads["motion"] ** 2
    result: NDArray[np.bool_] = np.append(False, contradicted) & np.append(contradicted, False)
    return result


def _likeliest(problem: Problem, state: State, spreads: Mapping[str, float], config: SolveConfig) -> State:
    """Levenberg-Marquardt; robust weights anew at every step."""
    blocks = problem.blocks(state)
    cost, damping = _cost(blocks, spreads), 1e-6
    for _ in range(config.max_steps):
        information = _total(_informations(blocks, spreads))
        gradient = _gradient(blocks, spreads)
        while True:
            ridge = information + np.diag(damping * np.diag(information))
            step = -cho_solve(cho_factor(ridge), gradient)
            trial = problem.moved(state, step)
            trial_blocks = problem.blocks(trial)
            trial_cost = _cost(trial_blocks, spreads)
            if trial_cost <= cost or damping > 1e6:
                break
            damping = max(10.0 * damping, 1e-4)
        if trial_cost > cost:
            break
        gain = cost - trial_cost
        state, blocks, cost, damping = trial, trial_blocks, trial_cost, max(0.1 * damping, 1e-9)
        if gain < config.settled:
            break
    return state


def _cost(blocks: Mapping[str, Block], spreads: Mapping[str, float]) -> float:
    """The negative log likelihood, up to a constant, for given spreads."""
    total = 0.0
    for name, block in blocks.items():
        square = _squares(block) / spreads.get(name, 1.0) ** 2
        if np.isinf(block.student):
            total += 0.5 * float(square.sum())
        else:
            peak = 0.5 * (block.student + block.residuals.shape[1])
            total += peak * float(np.log1p(square / block.student).sum())
    return total


def _squares(block: Block) -> Array:
    result: Array = (block.residuals**2).sum(axis=1)
    return result


def _weights(block: Block, spread: float) -> Array:
    """What robustness leaves of each residual, (n,), about one for good ones."""
    if np.isinf(block.student):
        return np.ones(len(block.residuals))
    size = block.residuals.shape[1]
    result: Array = (block.student + size) / (block.student + _squares(block) / spread**2)
    return result


def _informations(
    blocks: Mapping[str, Block], spreads: Mapping[str, float], expected: bool = False
) -> dict[str, csr_array]:
    """The normal matrix by kind of error.

    `expected`: as Fisher's information, which for Student's distribution is less than weighted squares say.
    """
    parts = {}
    for name, block in blocks.items():
        spread, size = spreads.get(name, 1.0), block.residuals.shape[1]
        weights = _weights(block, spread) / spread**2
        if expected and np.isfinite(block.student):
            weights = weights * (block.student + size) / (block.student + size + 2.0)
        each = diags_array(np.repeat(weights, size))
        parts[name] = csr_array(block.jacobian.T @ (each @ block.jacobian))
    return parts


def _total(parts: Mapping[str, csr_array]) -> Array:
    """The normal matrix of all kinds together."""
    total: Array = sum(parts.values(), csr_array(next(iter(parts.values())).shape)).toarray()
    return total


def _inverse(information: Array) -> Array:
    """The inverse of a positive definite matrix."""
    factor, _ = cho_factor(information, lower=True)
    half, _ = dpotri(factor, lower=True)
    result: Array = np.tril(half) + np.tril(half, -1).T
    return result


def _gradient(blocks: Mapping[str, Block], spreads: Mapping[str, float]) -> Array:
    """The slope of the cost, (unknowns,)."""
    total = np.zeros(blocks["prior"].jacobian.shape[1])
    for name, block in blocks.items():
        spread = spreads.get(name, 1.0)
        pull = block.residuals * (_weights(block, spread) / spread**2)[:, None]
        total += block.jacobian.T @ pull.ravel()
    return total


def _spreads(
    blocks: Mapping[str, Block], spreads: Mapping[str, float], by_wheels: bool, config: SolveConfig
) -> dict[str, float]:
    """Estimate the spreads anew, from those before."""
    parts = _informations(blocks, spreads)
    covariance = _inverse(_total(parts))
    result = {}
    for name, before in spreads.items():
        block, part = blocks[name], parts[name].tocoo()
        # The share of the residuals that the unknowns take up is the trace of covariance times information.
        used = float((covariance[part.row, part.col] * part.data).sum())
        left = block.residuals.size - used
        result[name] = before
        if left >= config.least_redundancy:
            square = float((_weights(block, before) * _squares(block)).sum()) / left
            low, high = config.spread_limits
            low = config.least_wheels if name == "motion" and by_wheels else low
            result[name] = float(np.clip(np.sqrt(square), low, high))
    return result
