"""What is asked of the light of a scene, checked once at construction."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from ..settings import member_of, whole_number

MAX_REFLECTORS = 4096  # more are a radiosity solution in disguise


class Quantity(enum.StrEnum):
    """What a bake stores."""

    OBSCURANCE = "OBSCURANCE"  # W: no unit, no light needed
    AMBIENT = "AMBIENT"  # all indirect light: R I_A W and what secondary reflectors redistributed
    DIRECT = "DIRECT"  # light that comes straight from lamps, emissive faces and the world
    COMBINED = "COMBINED"  # AMBIENT, DIRECT and what the faces emit themselves
    RADIOSITY = "RADIOSITY"  # the reference: COMBINED with all indirect light computed by radiosity


class Ambient(enum.StrEnum):
    """What the ambient light I_A is computed from."""

    RECEIVED = "RECEIVED"  # the direct light that surfaces receive and scatter
    EMISSION = "EMISSION"  # what lamps and surfaces emit: eqs. 3 and 4 of the 2003 paper


@dataclass(frozen=True)
class LightSettings:
    """Settings of the light.

    Parameters
    ----------
    quantity : Quantity
    ambient : Ambient
    reflectors : int or None
        Number of secondary reflectors that redistribute the direct light they receive, 0 .. 4096; None chooses as
        many as gain something.
    indirect_only : bool
        With RADIOSITY, leave out direct light and emission.

    Raises
    ------
    SettingsError
        When a value is out of range.
    """

    quantity: Quantity = Quantity.OBSCURANCE
    ambient: Ambient = Ambient.RECEIVED
    reflectors: int | None = None
    indirect_only: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "quantity", member_of(Quantity, self.quantity, "quantity"))
        object.__setattr__(self, "ambient", member_of(Ambient, self.ambient, "ambient"))
        if self.reflectors is not None:
            number = whole_number("number of reflectors", self.reflectors, 0, MAX_REFLECTORS)
            object.__setattr__(self, "reflectors", number)

    @property
    def needs_light(self) -> bool:
        """Whether the scene's light matters at all."""
        return self.quantity is not Quantity.OBSCURANCE
