"""``factorloc map facades``: a facade map from a building map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from factorloc.cli.console import console, progress_bar

if TYPE_CHECKING:
    from factorloc.mapping import FacadeMap

__all__ = ["facade_facts", "facades"]


def facades(
    buildings: Annotated[
        Path,
        typer.Argument(help="OpenStreetMap (.osm, .osm.pbf), GeoJSON, GeoPackage, Shapefile, CityGML or CityJSON."),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Map file to write: .h5, or .geojson to look at.")
    ] = Path("facades.h5"),
    shift: Annotated[
        float, typer.Option(min=0.0, help="Greatest shift of a building along x and y, m. OpenStreetMap: 1.5 to 2.")
    ] = 2.0,
    vertex_error: Annotated[
        float, typer.Option(min=0.0, help="Greatest error of a corner on top of that, m. OpenStreetMap: 0.2 to 0.3.")
    ] = 0.3,
    crs: Annotated[
        str | None, typer.Option(help="Coordinate system, as EPSG:25832, if the file names none or a wrong one.")
    ] = None,
    swap_axes: Annotated[
        bool, typer.Option("--swap-axes", help="The file has its coordinates in the other order than its system.")
    ] = False,
    datum: Annotated[
        str, typer.Option(help="Geographic system of the map's frame; 'file' keeps that of the file.")
    ] = "EPSG:4326",
    origin: Annotated[
        tuple[float, float] | None, typer.Option(help="Longitude and latitude of the map's origin, degrees.")
    ] = None,
    attribution: Annotated[
        str | None, typer.Option(help="Whom every picture and report has to name, if the file does not tell.")
    ] = None,
    least_length: Annotated[float, typer.Option(min=0.0, help="Leave out shorter walls, m.")] = 1.0,
    picture: Annotated[bool, typer.Option(help="Draw the map beside the file.")] = True,
) -> None:
    """Take the outer walls of buildings, with the errors the map is declared to have.

    [bold]Examples[/bold]

    [green]factorloc map facades town.osm -o facades.h5[/green]

    [green]factorloc map facades lod2.gml --crs EPSG:25832 --shift 0.2 --vertex-error 0.05 -o facades.h5[/green]
    """
    from factorloc.datasets import read_buildings
    from factorloc.errors import ConfigError
    from factorloc.mapping import FacadeMap, MapUncertainty, write_facade_geojson, write_facade_map
    from factorloc.viewer import plot_facade_map, save_figure

    ending = output.suffix.lower()
    if ending not in (".h5", ".hdf5", ".geojson"):
        raise ConfigError(f"{output}: facade maps are written as .h5 or .geojson; choose one of them")
    found = read_buildings(buildings, crs=crs, swap_axes=swap_axes, origin=origin, datum=datum, attribution=attribution)
    uncertainty = MapUncertainty(shift, vertex_error)
    with progress_bar("facades", len(found), "buildings") as progress:
        facade_map = FacadeMap.from_outlines(found, uncertainty, least_length=least_length, progress=progress)
    (write_facade_geojson if ending == ".geojson" else write_facade_map)(output, facade_map)
    console.print(f"{output}: {len(facade_map)} facades of {len(facade_map.outlines)} buildings", soft_wrap=True)
    for name, value in facade_facts(facade_map).items():
        console.print(f"[dim]{name}: {value}[/dim]", soft_wrap=True)
    if picture:
        file = output.with_suffix(".png")
        save_figure(plot_facade_map(facade_map), file)
        console.print(f"picture: {file}", soft_wrap=True)


def facade_facts(facade_map: FacadeMap) -> dict[str, str]:
    """What a facade map says of itself, in words."""
    x0, x1, y0, y1 = facade_map.extent
    lengths, frame = facade_map.facades.lengths, facade_map.frame
    facts = {
        "facades": f"{len(facade_map)}, {lengths.sum():.0f} m in all",
        "buildings": str(len(facade_map.outlines)),
        "extent": f"{x1 - x0:.0f} x {y1 - y0:.0f} m",
        "declared errors": f"shift {facade_map.uncertainty.shift:g} m, corners {facade_map.uncertainty.vertex:g} m",
        "origin": "no place on earth",
    }
    if frame is not None:
        system = frame.datum if len(frame.datum) < 20 else "the system of the file"
        facts["origin"] = f"longitude {frame.longitude:.7f}°, latitude {frame.latitude:.7f}° in {system}"
        facts["transformation"] = f"good to {frame.accuracy:g} m, added to the shift" if frame.accuracy else "exact"
    counts = ", ".join(f"{count} {reason}" for reason, count in facade_map.left_out.items())
    facts["left out"] = counts or "nothing"
    facts |= {f"provenance: {name}": text for name, text in facade_map.provenance.items()}
    return facts | ({"attribution": facade_map.attribution} if facade_map.attribution else {})
