"""What a bake did, for the status bar, the terminal and reports."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..light import BakedLight, Quantity
from ..lightmap import Lightmap
from ..notes import Notes, named
from ..settings import AUTO_DISTANCE_FRACTION
from ..tracing import SceneSize

_NAMES_IN_SUMMARY = 3


@dataclass(frozen=True)
class LightmapReport:
    """What a bake did to a lightmap.

    Attributes
    ----------
    image : str
        Name in the .blend.
    files : list of str
        None for a packed image.
    size, pages : int
    use : float
        Share of the pages that faces cover, 0 .. 1.
    traced_texels : int
        Covered texels that cast rays; the others were interpolated.
    texels_per_metre : float or None
        Density on all surfaces, where the bake unwrapped them.
    """

    image: str
    files: list[str]
    size: int
    pages: int
    use: float
    traced_texels: int
    texels_per_metre: float | None


@dataclass(frozen=True)
class BakeReport:
    """What a bake did.

    Attributes
    ----------
    objects : list of str
    patches, triangles, rays : int
        The patches of a lightmap are its texels. `rays` counts those for the error estimate too.
    seconds : dict of str to float
        Per phase: extract, build, trace, light, write; for a lightmap also unwrap and margin.
    r_ave, rmse : tuple of float
        Mean reflectance, and estimated error of the values written, per RGB channel.
    d_max : float
        Metres.
    reach_from : str
        What an automatic `d_max` came from; empty where the settings say it.
    quantity : Quantity
    ambient_light : tuple of float or None
        I_A per RGB channel, W/m^2, where the quantity has an ambient part.
    openness : float or None
        Share of the hemisphere without surfaces, averaged over the scene; with `ambient_light`.
    reflectors : int
        Secondary reflectors that redistributed direct light.
    reflected_share : float
        Share of the direct light scattered in the scene that they held.
    lightmap : LightmapReport or None
    warnings : list of str
    """

    objects: list[str]
    patches: int
    triangles: int
    rays: int
    seconds: dict[str, float]
    r_ave: tuple[float, float, float]
    rmse: tuple[float, float, float]
    d_max: float
    reach_from: str = ""
    quantity: Quantity = Quantity.OBSCURANCE
    ambient_light: tuple[float, float, float] | None = None
    openness: float | None = None
    reflectors: int = 0
    reflected_share: float = 0.0
    lightmap: LightmapReport | None = None
    warnings: list[str] = field(default_factory=list)

    def summary(self) -> str:
        """One line for the status bar or the terminal."""
        what = "" if self.quantity is Quantity.OBSCURANCE else f"{self.quantity.value.lower()} light of "
        reach = ""
        if self.quantity is Quantity.OBSCURANCE:
            reach = f" up to {self.d_max:.3g} m long" + (f" ({self.reach_from})" if self.reach_from else "")
        ambient = ""
        if self.ambient_light is not None:
            ambient = ", ambient light {:.3g} {:.3g} {:.3g} W/m2".format(*self.ambient_light)
            if self.reflectors:
                ambient += f" beside {self.reflectors} secondary reflectors"
        patches = f"{self.patches:,} patches"
        if self.lightmap is not None:
            of = self.lightmap
            pages = f"{of.pages} pages" if of.pages > 1 else "a page"
            patches = f"{self.patches:,} texels on {pages} of {of.size} ({of.use:.0%} used)"
        return (
            f"Baked {what}{patches} of {_named(self.objects)} with {self.rays:,} rays{reach} in "
            f"{sum(self.seconds.values()):.2f} s{ambient}, estimated error {max(self.rmse):.2g}"
        )


def reach_report(size: SceneSize, names: list[str]) -> str:
    """What the automatic distance came from; names are those of all objects, as `SceneSize` counts them."""
    notes = Notes()
    for what, left_out in (("far larger", size.far_larger), ("far away", size.astray)):
        notes.add(f"left out as {what}", *(names[number] for number in left_out))
    told = [f"{what}: {named(who)}" for what, who, _ in notes if who]
    return "; ".join([f"{AUTO_DISTANCE_FRACTION:g} of the size of what is baked", *told])


def ambient_report(light: BakedLight | Lightmap) -> dict[str, object]:
    """What a report says of the ambient light, where there is any."""
    if light.ambient is None:
        return {}
    return {
        "ambient_light": tuple(float(x) for x in light.ambient.intensity()),
        "openness": light.ambient.openness,
        "reflectors": light.reflectors,
        "reflected_share": light.reflected_share,
    }


def _named(objects: list[str]) -> str:
    """The first few names, and how many more there are."""
    names = [repr(name) for name in objects[:_NAMES_IN_SUMMARY]]
    if more := len(objects) - len(names):
        names.append(f"{more} more")
    return ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1]
