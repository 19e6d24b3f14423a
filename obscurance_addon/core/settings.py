"""What a bake is asked to compute, checked once at construction."""

from __future__ import annotations

import enum
import numbers
import operator
import os
from dataclasses import dataclass

from .errors import SettingsError
from .falloff import Falloff

AUTO_DISTANCE_FRACTION = 0.2  # of the size of what is baked; see docs/theory.md, "The reach d_max"
MIN_RAYS_PER_PATCH = 16  # floor when a ray budget is shared out by area: small patches must not starve
MAX_RAYS_PER_PATCH = 1 << 24
MAX_THREADS = 1024

_LABELS = {"rays": "rays per patch", "ray_budget": "ray budget", "seed": "seed", "threads": "threads"}


class Sampler(enum.StrEnum):
    """Where the points on patches and the directions come from."""

    SOBOL = "SOBOL"  # 4D Owen-scrambled Sobol points, jointly for point and direction
    RANDOM = "RANDOM"  # plain Monte Carlo, for comparison


@dataclass(frozen=True)
class BakeSettings:
    """Settings of the estimator.

    Parameters
    ----------
    rays : int
        Rays per patch, 1 .. 2**24. Powers of two use the Sobol points best.
    ray_budget : int or None
        Total number of rays to share out over the patches in proportion to area, at least 16 each (the 2003 paper's
        way). Replaces `rays` when given.
    distance : float or None
        d_max in metres, above 0, may be infinite; None takes 0.2 x the size of what is baked and stands by it.
    falloff : Falloff
        The distance function rho.
    use_bleeding : bool
        Weigh hits by the colour they hit (eq. 5) instead of by rho alone (eq. 2).
    sampler : Sampler
        Sobol or plain Monte Carlo.
    seed : int
        0 .. 2**32 - 1. The same seed casts the same rays.
    threads : int
        Number of tracing threads, 0 for all processors.

    Raises
    ------
    SettingsError
        When a value is out of range.
    """

    rays: int = 64
    ray_budget: int | None = None
    distance: float | None = None
    falloff: Falloff = Falloff.SQRT
    use_bleeding: bool = True
    sampler: Sampler = Sampler.SOBOL
    seed: int = 0
    threads: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "falloff", member_of(Falloff, self.falloff, "falloff"))
        object.__setattr__(self, "sampler", member_of(Sampler, self.sampler, "sampler"))
        for name, low, high in (
            ("rays", 1, MAX_RAYS_PER_PATCH),
            ("ray_budget", 1, 1 << 62),
            ("seed", 0, 2**32 - 1),
            ("threads", 0, MAX_THREADS),
        ):
            if name != "ray_budget" or self.ray_budget is not None:
                object.__setattr__(self, name, whole_number(_LABELS[name], getattr(self, name), low, high))
        if self.distance is not None and not isinstance(self.distance, numbers.Real):
            raise SettingsError(f"distance must be a number, not {self.distance!r}")
        if self.distance is not None and not self.distance > 0.0:
            raise SettingsError(
                f"distance is {self.distance:g} m, but rays need a length: give a distance above 0, or use the "
                "automatic distance"
            )

    def thread_count(self) -> int:
        """Number of threads to trace with: `threads`, or one for each processor this process may use."""
        if self.threads:
            return self.threads
        affinity = getattr(os, "sched_getaffinity", None)  # absent on Windows and macOS
        return len(affinity(0)) if affinity else os.cpu_count() or 1


def member_of(kind: type[enum.Enum], value: object, name: str) -> enum.Enum:
    """The member of an enum that a value stands for; raises SettingsError naming the choices."""
    try:
        return kind(value)
    except ValueError:
        choices = ", ".join(member.value for member in kind)
        raise SettingsError(f"{name} {value!r} is unknown: choose one of {choices}") from None


def whole_number(name: str, value: object, low: int, high: int) -> int:
    """A value as an int within low .. high; raises SettingsError naming the range."""
    try:
        number = operator.index(value)
    except TypeError:
        raise SettingsError(f"{name} must be a whole number, not {value!r}") from None
    if isinstance(value, bool):
        raise SettingsError(f"{name} must be a whole number, not {value!r}")
    if not low <= number <= high:
        raise SettingsError(f"{name} is {number}, allowed are {low} to {high}")
    return number
