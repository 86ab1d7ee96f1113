"""What has to wait for what, without barriers: a job is ready as soon as all that it depends on is settled."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
J = TypeVar("J")


@dataclass(frozen=True)
class Wait(Generic[K]):
    """The answer that a key cannot be decided before another is settled."""

    key: K


class Order(Generic[K, J]):
    """Keys on their way from waiting to settled.

    `examine` says of a key what its job is, None where there is nothing to do, or the first key that it waits for.
    What it says may depend on settled keys alone: then the jobs do not depend on the order in which others end. A key
    that another waits for need not be added.
    """

    def __init__(self, examine: Callable[[K], J | Wait[K] | None]) -> None:
        self._examine = examine
        self._waiting: dict[K, list[K]] = {}
        self._known: set[K] = set()
        self.settled: set[K] = set()

    def add(self, keys: Iterable[K]) -> list[J]:
        """Jobs among new keys that are ready now."""
        return [job for key in keys if key not in self._known for job in self._decide([key])]

    def settle(self, key: K) -> list[J]:
        """Jobs that become ready because a key's job is done."""
        self.settled.add(key)
        return self._decide(self._waiting.pop(key, []))

    def _decide(self, keys: list[K]) -> list[J]:
        jobs, keys = [], list(keys)
        for key in keys:
            self._known.add(key)
            found = self._examine(key)
            if isinstance(found, Wait):
                self._waiting.setdefault(found.key, []).append(key)
                keys += [found.key] if found.key not in self._known else []
            elif found is None:
                self.settled.add(key)
                keys += self._waiting.pop(key, [])
            else:
                jobs.append(found)
        return jobs
