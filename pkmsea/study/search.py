"""The outer loop of a study: numbers that the optimal control problem cannot move, searched by optuna."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pkmsea.errors import InputError
from pkmsea.study.points import Points
from pkmsea.study.study import Search, Study, Varied


class Searcher:
    """Asks for groups of trials (tree-structured Parzen estimator) and is told their energies.

    Seeded, and told in the order of asking: the same trials come whoever solves them, and after an interruption.
    """

    def __init__(self, study: Study, sample: Search) -> None:
        try:
            import optuna
        except ImportError:
            raise InputError(
                "optuna is not installed.", "Install it: pip install 'pkmsea[search]'.", file=study.file, key="sample"
            ) from None
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._failed = optuna.trial.TrialState.FAIL
        self._study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=sample.seed))
        self._ranges: dict[str, Any] = {
            name: optuna.distributions.CategoricalDistribution(varied.values)
            if varied.values is not None
            else optuna.distributions.FloatDistribution(*varied.ends, log=varied.logarithmic)
            for name, varied in study.vary.items()
        }
        self._varied, self._sample = study.vary, sample
        self._trials: list[Any] = []
        self._values: list[list[float]] = []
        self._unit: list[list[float]] = []
        self.asked = 0

    def ask(self) -> Points | None:
        """All points so far, the last `asked` of them new; None when there have been enough."""
        self.asked = min(self._sample.together, self._sample.count - len(self._values))
        if self.asked <= 0:
            return None
        self._trials = [self._study.ask(self._ranges) for _ in range(self.asked)]
        for trial in self._trials:
            self._values.append([float(trial.params[name]) for name in self._varied])
            self._unit.append([_unit(trial.params[name], varied) for name, varied in self._varied.items()])
        return Points(tuple(self._varied), np.array(self._unit), np.array(self._values))

    def tell(self, energies: Sequence[float | None]) -> None:
        """Energies of the last group, in its order; None for a trial without a verified solution."""
        for trial, energy in zip(self._trials, energies, strict=True):
            self._study.tell(trial, energy, state=self._failed if energy is None else None)


def _unit(value: float, varied: Varied) -> float:
    """Where a value lies between the ends of its range, 0 to 1."""
    if varied.values is not None:
        return varied.values.index(value) / max(len(varied.values) - 1, 1)
    low, high, x = np.log([*varied.ends, value]) if varied.logarithmic else (*varied.ends, value)
    return float((x - low) / (high - low))
